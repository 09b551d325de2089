import numpy as np
import pytest

from bushseg.geometry import open3d
from bushseg.simulation import SimulateConfig
from bushseg.simulation.scene import Scene
from bushseg.simulation.terrain import Terrain, cover, make_terrain, on_drive, waves


def test_height_on_a_hand_made_cell():
    terrain = Terrain(np.array([[0.0, 2.0], [1.0, 5.0]]), cell=1.0)
    xy = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0.5), (0.25, 0.25), (0.75, 0.75)])
    np.testing.assert_allclose(terrain.height(xy), (0, 1, 2, 5, 1.5, 0.75, 3.25))


def test_height_is_what_a_falling_ray_finds():
    rng = np.random.default_rng(1)
    config = SimulateConfig(size=20, relief=1.0, slope=15)
    terrain = make_terrain(rng, config)
    scene = Scene()
    scene.add(cover(rng, terrain, np.array([(2, 2), (18, 5)], float)), "ground", instance=False)
    xy = rng.uniform(0.1, 19.9, (2000, 2))
    rays = np.column_stack([xy, np.full(2000, 50.0), np.tile((0, 0, -1), (2000, 1))])
    tensor = open3d().core.Tensor.from_numpy(rays.astype(np.float32))
    hits = scene.caster().cast_rays(tensor)["t_hit"].numpy()
    np.testing.assert_allclose(50 - hits, terrain.height(xy), atol=1e-4)


def test_cover_holds_each_triangle_once():
    rng = np.random.default_rng(2)
    terrain = make_terrain(rng, SimulateConfig(size=20))
    surfaces = cover(rng, terrain, np.array([(0, 10), (20, 10)], float))
    triangles = np.concatenate([mesh.triangles for mesh, _ in surfaces])
    assert len(surfaces) == 3
    np.testing.assert_array_equal(
        np.unique(triangles, axis=0), np.unique(terrain.mesh().triangles, axis=0)
    )
    assert len(triangles) == len(terrain.mesh().triangles)


def test_slope_is_kept_within_what_was_asked():
    config = SimulateConfig(size=40, relief=0, slope=5)
    heights = make_terrain(np.random.default_rng(3), config).heights
    steepest = np.tan(np.radians(5)) * 40 * np.sqrt(2) + 0.2
    assert 0.5 < np.ptp(heights) < steepest


def test_waves_have_unit_variance():
    rng = np.random.default_rng(4)
    xy = rng.uniform(0, 2000, (20_000, 2))
    values = waves(rng, xy, shortest=8, longest=30)
    assert values.std() == pytest.approx(1, abs=0.05)


def test_drive_is_a_strip_with_round_ends():
    drive = np.array([(0, 0), (10, 0)], float)
    xy = np.array([(5, 1.4), (5, 1.6), (-1.4, 0), (-1.4, 1.4)])
    np.testing.assert_array_equal(on_drive(xy, drive), (True, False, True, False))
    assert not on_drive(xy, None).any()
