import numpy as np
import pytest

from bushseg.simulation.scene import Scene
from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.rays import BATCH_RAYS
from bushseg.simulation.sensors.spinning import frame_rays, map_rays, turn_of
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import Terrain

FLAT = Terrain(np.zeros((51, 51)), cell=0.4)
SITE = Site(Scene(), FLAT, np.array([(2.0, 10.0, 0.0), (18.0, 10.0, 0.0)]))
STEADY = {"line_jitter": 0, "registration_noise": 0, "sway": 0, "bob": 0}


def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize(
    ("lidar", "beams", "columns"),
    [("vlp-16", 16, 1800), ("hdl-32e", 32, 2250), ("hdl-64e", 64, 2000), ("os1-64", 64, 2048)],
)
def test_a_turn_is_as_published(lidar, beams, columns):
    turn = turn_of(rng(), SensorConfig(kind="spinning", lidar=lidar, line_jitter=0))
    assert turn.shape == (beams * columns, 3)
    azimuths = np.unwrap(np.arctan2(turn[::beams, 1], turn[::beams, 0]))
    np.testing.assert_allclose(np.diff(azimuths), 2 * np.pi / columns)


def test_a_tripod_has_no_beams_that_turn():
    with pytest.raises(ValueError, match="tripod"):
        turn_of(rng(), SensorConfig())


def test_frames_are_spread_along_the_path_in_coordinates_of_their_own():
    config = SensorConfig(kind="spinning", frames=2, **STEADY)
    batches = list(frame_rays(rng(), SITE, config))
    places = {rays.station: tuple(rays.origins[0]) for rays in batches}
    assert list(places) == [1, 2]
    np.testing.assert_allclose([*places.values()], [(6, 10, 1.6), (14, 10, 1.6)])
    assert all(len(rays) <= BATCH_RAYS for rays in batches)
    assert not any(rays.reported_origins.any() for rays in batches)
    # The path runs along x, and so does the frame.
    np.testing.assert_allclose(batches[0].reported_directions, batches[0].directions, atol=1e-12)


def test_a_vehicle_leans_with_the_ground():
    slope = Terrain(np.broadcast_to(np.arange(51)[:, None] * 0.1, (51, 51)), cell=0.4)
    uphill = Site(Scene(), slope, SITE.stations)
    rays = next(frame_rays(rng(), uphill, SensorConfig(kind="spinning", **STEADY)))
    turned = np.linalg.lstsq(rays.reported_directions, rays.directions, rcond=None)[0]
    np.testing.assert_allclose(turned[0], np.array([4, 0, 1]) / np.sqrt(17), atol=1e-9)


@pytest.mark.parametrize("kind", ["mobile", "vehicle"])
def test_a_map_is_turns_along_the_path(kind):
    config = SensorConfig(kind=kind, turn_spacing=4, **STEADY)
    batches = list(map_rays(rng(), SITE, config))
    assert {rays.station for rays in batches} == {1}
    np.testing.assert_allclose(np.unique([r.origins[0, 0] for r in batches]), [2, 6, 10, 14, 18])
    firsts = np.cumsum([0, *(len(rays) for rays in batches[:-1])])
    assert [rays.first for rays in batches] == firsts.tolist()


def test_a_carried_head_looks_everywhere():
    config = SensorConfig(kind="mobile", turn_spacing=1)
    up = np.concatenate([rays.directions[:, 2] for rays in map_rays(rng(), SITE, config)])
    assert up.min() < -0.8
    assert up.max() > 0.8


def test_a_path_drifts_slowly():
    config = SensorConfig(kind="mobile", turn_spacing=0.5, **{**STEADY, "registration_noise": 0.1})
    shifts = np.array(
        [rays.reported_origins[0] - rays.origins[0] for rays in map_rays(rng(), SITE, config)]
    )
    assert 0.02 < np.abs(shifts).max() < 0.3
    assert np.abs(np.diff(shifts, axis=0)).max() < 0.05
