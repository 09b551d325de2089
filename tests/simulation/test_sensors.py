from itertools import pairwise

import numpy as np
import pytest

from bushseg.simulation import SimulateConfig, sensors
from bushseg.simulation.scene import Scene
from bushseg.simulation.sensors import SENSORS
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import Terrain

SITE = Site(
    Scene(), Terrain(np.zeros((51, 51)), cell=0.4), np.array([(5.0, 5.0, 0.0), (15.0, 9.0, 0.0)])
)


def directions(batches):
    return np.concatenate([rays.directions for rays in batches])


@pytest.mark.parametrize("name", SENSORS)
def test_directions_are_unit_vectors(name):
    config = SimulateConfig(size=20, sensor=name, stations=2, angular_step=3, pulse_spacing=0.5)
    rays = directions(SENSORS[name](SITE, config))
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1)


def test_tripod_covers_the_sphere_from_each_station():
    config = SimulateConfig(size=20, stations=2, angular_step=5)
    first, second = SENSORS["tripod"](SITE, config)
    assert (first.station, second.station) == (1, 2)
    assert len(first.directions) == 72 * 29
    np.testing.assert_allclose(second.origins[0], (15, 9, sensors.TRIPOD_HEIGHT))
    # The mirror is fast, the head slow.
    elevations = np.degrees(np.arcsin(first.directions[:29, 2]))
    np.testing.assert_allclose(elevations, np.arange(-60, 85, 5), atol=1e-9)
    np.testing.assert_allclose(first.directions[:29, 1], 0, atol=1e-12)


def test_batches_are_bounded_and_change_nothing(monkeypatch):
    config = SimulateConfig(size=20, stations=2, angular_step=5)
    whole = directions(SENSORS["tripod"](SITE, config))
    monkeypatch.setattr(sensors, "BATCH_RAYS", 300)
    batches = list(SENSORS["tripod"](SITE, config))
    np.testing.assert_array_equal(directions(batches), whole)
    assert max(len(rays.directions) for rays in batches) <= 300
    for before, after in pairwise(batches):
        if before.station == after.station:
            assert after.first == before.first + len(before.directions)


def test_airborne_rays_fall_within_the_scan_angle():
    config = SimulateConfig(
        size=20, sensor="airborne", stations=2, scan_angle=15, pulse_spacing=0.25
    )
    batches = list(SENSORS["airborne"](SITE, config))
    rays = directions(batches)
    angles = np.degrees(np.arccos(-rays[:, 2]))
    assert 14 < angles.max() <= 15 + 1e-9
    np.testing.assert_array_equal(np.unique(batches[0].origins[:, 0]), [5.0])
    np.testing.assert_array_equal(np.unique(batches[-1].origins[:, 0]), [15.0])
    landing = batches[0].origins + batches[0].directions * (
        -batches[0].origins[:, 2:] / batches[0].directions[:, 2:]
    )
    np.testing.assert_allclose(landing[1] - landing[0], (0.25, 0, 0), atol=1e-9)


def test_spinning_is_one_turn_of_64_beams():
    batches = list(SENSORS["spinning"](SITE, SimulateConfig(size=20, sensor="spinning")))
    assert len(directions(batches)) == 64 * 2000
    np.testing.assert_allclose(batches[0].origins[0], (5, 5, sensors.SPINNING_HEIGHT))
