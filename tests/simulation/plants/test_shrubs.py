import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.simulation.plants import PlantsConfig, grow_hedge, grow_shrub
from bushseg.simulation.plants.shrubs import HABITS

LEAVED = PlantsConfig(shrub_leafless=0, shrub_shoots=0)


def vertices(plant):
    return np.concatenate([mesh.vertices for mesh, _ in plant.model])


def num_triangles(plant):
    return sum(len(mesh.triangles) for mesh, _ in plant.model)


@pytest.mark.parametrize("habit", HABITS)
@pytest.mark.parametrize("height", [0.4, 1.2, 4.0])
def test_shrub_has_the_size_asked_for(habit, height):
    shrub = grow_shrub(np.random.default_rng(0), LEAVED, habit, height)
    assert shrub.class_name == "bush"
    assert np.isfinite(vertices(shrub)).all()
    assert 0.85 * height < shrub.height < 1.1 * height + 0.15
    widest = HABITS[habit].width[1] * height / 2
    assert shrub.radius < 1.35 * widest + 0.2
    assert vertices(shrub)[:, 2].min() < 0  # stems are rooted
    assert 300 < num_triangles(shrub) < 20_000


def test_shoots_stand_out_of_the_crown():
    tops = []
    for share in (0, 1):
        config = PlantsConfig(shrub_leafless=0, shrub_shoots=share)
        grown = (grow_shrub(np.random.default_rng(n), config, "mounded", 1.5) for n in range(6))
        tops.append(np.mean([shrub.height for shrub in grown]))
    assert 0.05 < tops[1] - tops[0] < 0.8


def test_stated_size_is_measured():
    shrub = grow_shrub(np.random.default_rng(3), LEAVED)
    xyz = vertices(shrub)
    assert shrub.height == xyz[:, 2].max()
    assert shrub.radius == pytest.approx(np.hypot(xyz[:, 0], xyz[:, 1]).max())


def test_a_seed_grows_one_shrub():
    one, same, other = (grow_shrub(np.random.default_rng(seed), LEAVED) for seed in (5, 5, 6))
    np.testing.assert_array_equal(vertices(one), vertices(same))
    assert len(vertices(one)) != len(vertices(other))


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 8), st.sampled_from(sorted(HABITS)))
@settings(max_examples=20)
def test_any_shrub_is_sound(seed, height, habit):
    config = PlantsConfig(detail=0.2, shrub_leafless=0.5, shrub_shoots=0)
    shrub = grow_shrub(np.random.default_rng(seed), config, habit, height)
    assert np.isfinite(vertices(shrub)).all()
    assert 0.8 * height < shrub.height < 1.3 * height + 0.2


def test_leafless_shrubs_are_mostly_twigs():
    bare = PlantsConfig(shrub_leafless=1)
    for seed in range(4):
        shrub = grow_shrub(np.random.default_rng(seed), bare, "mounded", 1.5)
        leaves, wood = (len(mesh.triangles) for mesh, _ in shrub.model)
        assert leaves < 0.5 * wood


def test_heights_follow_the_settings():
    low = PlantsConfig(shrub_height=(0.3, 0.4, 0.5))
    heights = [grow_shrub(np.random.default_rng(seed), low).height for seed in range(20)]
    assert 0.2 < np.median(heights) < 0.6


def test_no_shrub_is_drawn_as_high_as_a_tree():
    giants = PlantsConfig(shrub_height=(8.0, 9.0, 10.0), shrub_shoots=0, detail=0.2)
    assert grow_shrub(np.random.default_rng(0), giants).height < 6.1


def test_detail_changes_triangles_and_not_size():
    fine, coarse = (
        grow_shrub(np.random.default_rng(1), LEAVED.model_copy(update={"detail": d}), "dense", 3.0)
        for d in (1.0, 0.25)
    )
    assert num_triangles(coarse) < 0.6 * num_triangles(fine)
    assert coarse.height == pytest.approx(fine.height, rel=0.2)


@pytest.mark.parametrize("clipped", [0.0, 1.0])
@pytest.mark.parametrize("length", [1.0, 12.0])
def test_hedge_runs_along_x(clipped, length):
    config = PlantsConfig(hedge_clipped=clipped)
    hedge = grow_hedge(np.random.default_rng(2), config, length, height=1.5)
    xyz = vertices(hedge)
    assert hedge.class_name == "bush"
    assert np.isfinite(xyz).all()
    assert 0.6 * length < np.ptp(xyz[:, 0]) < length + 4
    assert 1.0 < hedge.height < 2.3


def test_clipped_hedges_are_flat():
    config = PlantsConfig(hedge_clipped=1, shrub_leafless=0)
    hedge = grow_hedge(np.random.default_rng(2), config, 8.0, height=1.5)
    z = hedge.model[0].mesh.vertices[:, 2]
    assert np.quantile(z, 0.99) < 1.62
    assert np.mean(z > 1.3) > 0.15  # the top is a face full of leaves
