import numpy as np
import pytest

from bushseg.simulation import SimulateConfig
from bushseg.simulation.foliage import SPRIGS, foliage, leaf_area, meadow
from bushseg.simulation.materials import BARK
from bushseg.simulation.plants import HABITS, bush, tree
from bushseg.simulation.terrain import Terrain


def vertices(model):
    return np.concatenate([mesh.vertices for mesh, _ in model])


@pytest.mark.parametrize("habit", HABITS)
@pytest.mark.parametrize("height", [0.4, 1.2, 3.0])
def test_bush_has_the_size_asked_for(habit, height):
    width = 6.0 if habit == "hedge" else height
    plant = bush(np.random.default_rng(0), habit, height, width)
    leaves = plant[0].mesh.vertices
    assert np.isfinite(vertices(plant)).all()
    assert 0.7 * height < leaves[:, 2].max() < 1.25 * height + 0.35
    assert np.ptp(leaves[:, 0]) < 1.4 * width + 0.7
    assert leaves[:, 2].min() < 0.4 * height


def test_hedge_runs_along_x():
    leaves = bush(np.random.default_rng(0), "hedge", 1.5, 8.0)[0].mesh.vertices
    assert np.ptp(leaves[:, 0]) > 4 * np.ptp(leaves[:, 1])


@pytest.mark.parametrize("form", ["broadleaf", "conifer"])
def test_tree_has_trunk_and_crown(form):
    plant = tree(np.random.default_rng(1), form, 12.0, 5.0, 4.0)
    (leaves, _), (wood, material) = plant
    assert material is BARK
    assert wood.vertices[:, 2].min() < 0 < leaves.vertices[:, 2].min()
    assert 10.5 < leaves.vertices[:, 2].max() < 14
    assert np.percentile(leaves.vertices[:, 2], 2) > 2.5
    assert np.isfinite(vertices(plant)).all()


def test_crown_may_begin_low():
    low = tree(np.random.default_rng(1), "broadleaf", 10.0, 5.0, 0.5)[0].mesh.vertices
    assert np.percentile(low[:, 2], 2) < 2


def test_foliage_is_sprigs_repeated():
    positions = np.array([(0, 0, 1), (50, 0, 1)], float)
    mesh = foliage(np.random.default_rng(0), "broad", positions)
    prototype = SPRIGS["broad"]
    assert len(mesh.vertices) == 2 * len(prototype.vertices)
    assert np.abs(mesh.vertices[: len(prototype.vertices)] - (0, 0, 1)).max() < 0.4
    assert np.abs(mesh.vertices[len(prototype.vertices) :] - (50, 0, 1)).max() < 0.4


def test_leaf_area_of_a_sprig():
    # A rhombus 0.075 by 0.045 m, folded: each half is a triangle of height (1, 0.3) * 0.0225.
    half = 0.5 * 0.075 * 0.0225 * np.hypot(1, 0.3)
    assert leaf_area("broad") == pytest.approx(8 * 2 * half, rel=1e-4)


def test_meadow_keeps_off_the_drive_and_stands_on_the_ground():
    terrain = Terrain(np.full((51, 51), 7.0), cell=0.4)
    config = SimulateConfig(size=20, grass_density=30)
    drive = np.array([(0, 10), (20, 10)], float)
    ((mesh, _),) = meadow(np.random.default_rng(0), terrain, config, drive)
    blades = mesh.vertices[mesh.triangles]
    np.testing.assert_allclose(blades[:, :2, 2], 7.0)
    assert (blades[:, 2, 2] > 7.02).all()
    roots = blades[:, :2].mean(axis=1)
    assert (np.abs(roots[:, 1] - 10) > 1.49).all()
    assert len(blades) > 0.6 * 30 * 400


def test_no_grass_where_none_is_wanted():
    terrain = Terrain(np.zeros((51, 51)), cell=0.4)
    config = SimulateConfig(size=20, grass_density=0)
    assert meadow(np.random.default_rng(0), terrain, config, None) == []
