import numpy as np
import pytest

from bushseg.simulation.plants import PlantsConfig, grow_dead_wood, grow_sapling, grow_tree
from bushseg.simulation.plants.dead_wood import KINDS
from bushseg.simulation.plants.tree_forms import FORMS

LEAVED = PlantsConfig(tree_leafless=0, tree_ivy=0)


def vertices(plant):
    return np.concatenate([mesh.vertices for mesh, _ in plant.model])


def num_triangles(plant):
    return sum(len(mesh.triangles) for mesh, _ in plant.model)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("low_crown", [False, True])
def test_tree_has_the_size_asked_for(form, low_crown):
    height = float(np.clip(11.0, *FORMS[form].heights))
    tree = grow_tree(np.random.default_rng(1), LEAVED, form, height, low_crown=low_crown)
    assert tree.class_name == "tree"
    assert np.isfinite(vertices(tree)).all()
    assert 0.9 * height < tree.height < 1.1 * height + 0.5
    assert tree.radius < 0.75 * FORMS[form].width[1] * height + 1
    assert vertices(tree)[:, 2].min() < 0
    assert 4_000 < num_triangles(tree) < 60_000


@pytest.mark.parametrize("form", ["round", "cone"])
def test_low_crowns_reach_the_ground_and_others_do_not(form):
    low, high = (
        grow_tree(np.random.default_rng(1), LEAVED, form, 12.0, low_crown=low).model[1].mesh
        for low in (True, False)
    )
    assert np.quantile(low.vertices[:, 2], 0.02) < 1.5
    assert np.quantile(high.vertices[:, 2], 0.02) > 0.5 * FORMS[form].base[0] * 12
    assert np.quantile(low.vertices[:, 2], 0.05) < np.quantile(high.vertices[:, 2], 0.05)


def test_one_stem_unless_told_otherwise():
    stem = grow_tree(np.random.default_rng(1), LEAVED, "round", 12.0, low_crown=False)
    wood = stem.model[0].mesh.vertices
    foot = wood[(wood[:, 2] > 0.2) & (wood[:, 2] < 1.0)]
    assert np.hypot(foot[:, 0], foot[:, 1]).max() < 0.6


def test_winter_trees_have_no_leaves_and_conifers_keep_needles():
    winter = PlantsConfig(tree_leafless=1, tree_ivy=0)
    assert len(grow_tree(np.random.default_rng(0), winter, "round", 8.0).model) == 1
    assert len(grow_tree(np.random.default_rng(0), winter, "cone", 8.0).model) == 2


def test_ivy_clothes_the_lower_stem():
    config = PlantsConfig(tree_leafless=1, tree_ivy=1)
    wood, ivy = grow_tree(np.random.default_rng(0), config, "columnar", 12.0).model
    assert len(ivy.mesh.triangles) > 100
    assert ivy.mesh.vertices[:, 2].max() < 0.8 * wood.mesh.vertices[:, 2].max()


def test_heights_are_brought_within_what_a_form_can_have():
    for seed in range(5):
        tree = grow_tree(np.random.default_rng(seed), PlantsConfig(), "fruit")
        assert tree.height < 1.25 * FORMS["fruit"].heights[1] + 0.5


def test_a_seed_grows_one_tree():
    one, same = (grow_tree(np.random.default_rng(5), LEAVED) for _ in range(2))
    np.testing.assert_array_equal(vertices(one), vertices(same))


@pytest.mark.parametrize("seed", range(12))
def test_saplings_are_small_trees(seed):
    sapling = grow_sapling(np.random.default_rng(seed), PlantsConfig())
    assert sapling.class_name == "tree"
    assert np.isfinite(vertices(sapling)).all()
    assert 1.0 < sapling.height < 6
    assert num_triangles(sapling) < 30_000


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_dead_wood(kind, seed):
    piece = grow_dead_wood(np.random.default_rng(seed), PlantsConfig(), kind)
    assert piece.class_name == ("bush" if kind == "heap" else "tree")
    assert np.isfinite(vertices(piece)).all()
    assert 0.1 < piece.height < 11
