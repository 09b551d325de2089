import numpy as np
import pytest

from bushseg.geometry import open3d
from bushseg.simulation.scene import Scene
from bushseg.simulation.terrain import Terrain, TerrainConfig, make_terrain, waves


def terrain_of(size, **settings):
    wanted = {"slope": 5, "relief": 0.2, "roughness": 0.01, **settings}
    return make_terrain(np.random.default_rng(1), TerrainConfig(), size, **wanted)


def test_height_on_a_hand_made_cell():
    terrain = Terrain(np.array([[0.0, 2.0], [1.0, 5.0]]), cell=1.0)
    xy = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0.5), (0.25, 0.25), (0.75, 0.75)])
    np.testing.assert_allclose(terrain.height(xy), (0, 1, 2, 5, 1.5, 0.75, 3.25))


def test_height_is_what_a_falling_ray_finds():
    rng = np.random.default_rng(1)
    terrain = terrain_of(20, relief=1.0, slope=15)
    scene = Scene()
    scene.add([(terrain.mesh(), None)], "ground", instance=False)
    xy = rng.uniform(0.1, 19.9, (2000, 2))
    rays = np.column_stack([xy, np.full(2000, 50.0), np.tile((0, 0, -1), (2000, 1))])
    tensor = open3d().core.Tensor.from_numpy(rays.astype(np.float32))
    hits = scene.caster().cast_rays(tensor)["t_hit"].numpy()
    np.testing.assert_allclose(50 - hits, terrain.height(xy), atol=1e-4)


def test_slope_is_kept_within_what_was_asked():
    heights = terrain_of(40, relief=0, slope=30).heights
    steepest = np.tan(np.radians(30)) * 40 * np.sqrt(2) + 0.2
    assert 0.3 * steepest < np.ptp(heights) < steepest


@pytest.mark.parametrize("size", [20.0, 33.3, 100.0])
def test_cells_fit_the_site(size):
    terrain = terrain_of(size)
    assert (len(terrain.heights) - 1) * terrain.cell == pytest.approx(size)
    assert 0.15 < terrain.cell <= 0.4


def test_waves_have_unit_variance():
    rng = np.random.default_rng(4)
    xy = rng.uniform(0, 2000, (20_000, 2))
    values = waves(rng, xy, shortest=8, longest=30)
    assert values.std() == pytest.approx(1, abs=0.05)
