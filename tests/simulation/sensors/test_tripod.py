from itertools import pairwise

import numpy as np

from bushseg.simulation.scene import Scene
from bushseg.simulation.sensors import SensorConfig, tripod
from bushseg.simulation.sensors.tripod import tripod_rays
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import Terrain

SITE = Site(
    Scene(), Terrain(np.zeros((51, 51)), cell=0.4), np.array([(5.0, 5.0, 0.0), (15.0, 9.0, 0.0)])
)
STEADY = {"line_jitter": 0, "registration_noise": 0}


def rays_of(**settings):
    config = SensorConfig(**{"angular_step": 5, **settings})
    return list(tripod_rays(np.random.default_rng(0), SITE, config))


def directions(batches):
    return np.concatenate([rays.directions for rays in batches])


def test_a_pulse_scanner_sees_a_hundred_degrees_from_each_station():
    first, second = rays_of(**STEADY)
    assert (first.station, second.station) == (1, 2)
    assert len(first) == 72 * 20
    np.testing.assert_allclose(second.origins[0], (15, 9, 1.7))
    # The mirror is fast, the head slow.
    elevations = np.degrees(np.arcsin(first.directions[:20, 2]))
    np.testing.assert_allclose(elevations, np.arange(-40, 60, 5), atol=1e-9)
    azimuths = np.degrees(np.arctan2(first.directions[:40, 1], first.directions[:40, 0]))
    np.testing.assert_allclose(azimuths[:20], azimuths[0])
    assert (azimuths[20] - azimuths[0]) % 360 == np.float64(5).round() or np.isclose(
        (azimuths[20] - azimuths[0]) % 360, 5
    )
    np.testing.assert_array_equal(first.reported_directions, first.directions)


def test_a_phase_scanner_sees_all_but_its_feet():
    first, _ = rays_of(kind="phase", **STEADY)
    elevations = np.degrees(np.arcsin(first.directions[:, 2]))
    np.testing.assert_allclose([elevations.min(), elevations.max()], [-60, 85])


def test_batches_are_bounded_and_change_nothing(monkeypatch):
    whole = directions(rays_of())
    monkeypatch.setattr(tripod, "BATCH_RAYS", 300)
    batches = rays_of()
    np.testing.assert_array_equal(directions(batches), whole)
    assert max(len(rays) for rays in batches) <= 300
    for before, after in pairwise(batches):
        if before.station == after.station:
            assert after.first == before.first + len(before)


def test_stations_get_out_of_register():
    for rays in rays_of(line_jitter=0, registration_noise=0.1):
        shift = rays.reported_origins - rays.origins
        assert 0.01 < np.linalg.norm(shift[0]) < 0.5
        np.testing.assert_array_equal(shift, np.broadcast_to(shift[0], shift.shape))
        turn = np.arccos(np.clip((rays.reported_directions * rays.directions).sum(axis=1), -1, 1))
        assert turn.max() < 0.02


def test_jitter_moves_whole_columns_by_less_than_half_a_step():
    steady, shaken = directions(rays_of(**STEADY)), directions(rays_of(registration_noise=0))
    angles = np.degrees(np.arccos(np.clip((steady * shaken).sum(axis=1), -1, 1)))
    assert 0.1 < angles.max() <= 0.3 * 5 / 2 * np.sqrt(2) + 1e-6
