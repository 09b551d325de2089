import numpy as np
import pytest

from bushseg.simulation.scene import Scene
from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.aerial import strip_offsets, strip_rays
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import Terrain

SITE = Site(Scene(), Terrain(np.zeros((51, 51)), cell=0.4), np.array([(5.0, 5.0, 0.0)]))


def landing(rays):
    return rays.origins - rays.directions * (rays.origins[:, 2:] / rays.directions[:, 2:])


@pytest.mark.parametrize("kind", ["uav", "airborne"])
def test_rays_fall_on_the_site_within_the_scan_angle(kind):
    config = SensorConfig(kind=kind, pulse_spacing=0.5)
    batches = list(strip_rays(np.random.default_rng(0), SITE, config))
    figures = config.figures
    for rays in batches:
        np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1)
        angles = np.degrees(np.arccos(-rays.directions[:, 2]))
        assert (angles <= figures.scan_angle + 1e-9).all()
        spots = landing(rays)[:, :2]
        assert ((spots > -1e-6) & (spots < 20 + 1e-6)).all()
        np.testing.assert_allclose(rays.origins[:, 2], figures.flight_height)


def test_a_strip_that_covers_the_site_has_the_density_asked_for():
    config = SensorConfig(kind="airborne", pulse_spacing=0.5)
    by_strip = {}
    for rays in strip_rays(np.random.default_rng(1), SITE, config):
        by_strip[rays.station] = by_strip.get(rays.station, 0) + len(rays)
    assert max(by_strip.values()) == pytest.approx(4 * 20 * 20, rel=0.05)


@pytest.mark.parametrize("overlap", [0.0, 0.3, 0.6])
def test_strips_overlap_as_asked(overlap):
    figures = SensorConfig(kind="uav", overlap=overlap).figures
    rng = np.random.default_rng(0)
    seen = []
    for _ in range(300):
        offsets = strip_offsets(rng, figures, half_width=40.0, size=20.0)
        np.testing.assert_allclose(np.diff(offsets), 80 * (1 - overlap))
        seen.append((np.abs(offsets) <= 40).sum())  # strips that see the middle
    assert min(seen) >= 1
    assert np.mean(seen) == pytest.approx(1 / (1 - overlap), rel=0.1)


def test_strips_are_off_as_a_whole():
    config = SensorConfig(kind="uav", pulse_spacing=1, overlap=0.7, registration_noise=0.1)
    shifts = {}
    for rays in strip_rays(np.random.default_rng(0), SITE, config):
        off = rays.reported_origins - rays.origins
        np.testing.assert_allclose(off, np.broadcast_to(off[0], off.shape), atol=1e-12)
        shifts[rays.station] = off[0]
    assert len(shifts) > 1
    assert len({tuple(shift.round(6)) for shift in shifts.values()}) == len(shifts)
