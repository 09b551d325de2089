import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.errors import ConfigError
from bushseg.simulation.materials import BARK
from bushseg.simulation.mesh import Surface, box
from bushseg.simulation.plants import Plant, PlantsConfig, Pool, scatter
from bushseg.simulation.plants.branches import (
    Branches,
    allotted,
    blades,
    reaching,
    sprouting,
    tilted,
)
from bushseg.simulation.plants.crowns import foliage, volume, within
from bushseg.simulation.plants.distributions import choose, draw_many
from bushseg.simulation.plants.leaves import DENSITIES, LeafKind, inclinations, leaves
from bushseg.simulation.plants.scatter import assigned, patches


def area(mesh):
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2).astype(float)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def one_branch():
    paths = np.array([[(0, 0, 0), (0, 0, 1), (0, 0, 2)]], float)
    return Branches(paths, np.array([[0.3, 0.2, 0.1]]))


def test_places_along_a_branch():
    places, tangents, radii = one_branch().at(np.zeros(3, int), np.array([0.0, 0.25, 1.0]))
    np.testing.assert_allclose(places, [(0, 0, 0), (0, 0, 0.5), (0, 0, 2)])
    np.testing.assert_allclose(tangents, [(0, 0, 1)] * 3)
    np.testing.assert_allclose(radii, [0.3, 0.25, 0.1])
    np.testing.assert_allclose(one_branch().lengths(), [2])


def test_branches_reach_their_tips():
    feet, tips = np.zeros((2, 3)), np.array([(1, 0, 1), (0, 2, 0)], float)
    paths = reaching(feet, tips / 2, tips, np.array([0.1, 0.2]), 5).paths
    np.testing.assert_allclose(paths[:, 0], feet)
    np.testing.assert_allclose(paths[:, -1], tips)
    np.testing.assert_allclose(paths[:, 2], tips / 2)


@given(st.integers(0, 2**32 - 1), st.floats(0, 180))
def test_tilted_stand_off_by_the_angle(seed, angle):
    rng = np.random.default_rng(seed)
    axes = rng.standard_normal((20, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    directions = tilted(rng, axes, angle)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-9)
    np.testing.assert_allclose(
        (axes * directions).sum(axis=1), np.cos(np.radians(angle)), atol=1e-9
    )


def test_sprouts_leave_their_parent_where_told():
    rng = np.random.default_rng(0)
    twigs = sprouting(rng, one_branch(), 50, start=0.5, angle=(45, 5), length=(0.1, 0.2))
    feet = twigs.paths[:, 0]
    np.testing.assert_allclose(feet[:, :2], 0, atol=1e-12)
    assert (feet[:, 2] >= 1).all()
    assert (feet[:, 2] <= 2).all()
    assert (twigs.lengths() >= 0.1 - 1e-9).all()
    assert (twigs.lengths() <= 0.2 + 1e-9).all()


def test_allotted_by_shares():
    index = allotted(np.random.default_rng(0), np.array([3.0, 0.0, 1.0]), 400)
    assert np.bincount(index, minlength=3).tolist() == pytest.approx([300, 0, 100], abs=1)
    assert (np.diff(index) >= 0).all()


def test_blades_have_a_rods_area():
    # A rod of radius 1 cm and length 1 m shows 2 r L = 0.02 m²; two crossed blades, seen from
    # any side, show about 0.9 of one blade's area.
    rod = Branches(np.array([[(0, 0, 0), (0, 0, 1)]], float), np.full((1, 2), 0.01))
    np.testing.assert_allclose(area(blades(np.random.default_rng(0), rod)), 0.022, rtol=1e-5)


def test_leaves_have_the_area_asked_for():
    kind = LeafKind(0.1, 0.5, "spherical")
    twigs = Branches(np.array([[(0, 0, 1), (0, 0, 3)]], float), np.full((1, 2), 0.01))
    mesh = foliage(np.random.default_rng(0), twigs, kind, area=20.0, most=5000)
    assert area(mesh).sum() == pytest.approx(20, rel=0.03)
    few = foliage(np.random.default_rng(0), twigs, kind, area=20.0, most=2000)
    assert len(few.triangles) == 2000
    assert area(few).sum() == pytest.approx(20, rel=0.05)


@pytest.mark.parametrize(
    ("angles", "mean"),
    [("spherical", 57.3), ("planophile", 26.8), ("erectophile", 63.2), ("plagiophile", 45.0)],
)
def test_leaf_inclinations_after_de_wit(angles, mean):
    rng = np.random.default_rng(0)
    drawn = np.degrees(inclinations(rng, angles, 20_000))
    assert drawn.mean() == pytest.approx(mean, abs=0.8)
    assert set(DENSITIES) == {"spherical", "planophile", "erectophile", "plagiophile"}
    kind = LeafKind(0.1, 0.5, angles)
    mesh = leaves(rng, np.zeros((20_000, 3)), rng.standard_normal((20_000, 3)), kind)
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2).astype(float)
    normals = np.cross(b - a, c - a)
    steep = np.abs(normals[:, 2]) / np.linalg.norm(normals, axis=1)
    assert np.degrees(np.arccos(steep)).mean() == pytest.approx(mean, abs=0.8)


def test_within_stays_within_the_profile():
    profile = np.array([1.0, 0.5, 0.0])
    places = within(np.random.default_rng(0), profile, 500, filling=2.0)
    out = np.hypot(places[:, 0], places[:, 1])
    assert (places[:, 2] >= 0).all()
    assert (places[:, 2] <= 1).all()
    assert (out < 1.8 * (1.02 - places[:, 2])).all()


def test_volume_of_a_cylinder():
    assert volume(np.ones(4), 2.0, 3.0) == pytest.approx(12 * np.pi)


def test_spread_is_its_quantiles():
    drawn = draw_many(np.random.default_rng(0), (0.5, 1.0, 4.0), 20_000)
    np.testing.assert_allclose(np.quantile(drawn, (0.05, 0.5, 0.95)), (0.5, 1, 4), rtol=0.06)


def test_weights_decide():
    rng = np.random.default_rng(0)
    drawn = [choose(rng, {"a": 3.0, "b": 1.0, "c": 0.0}) for _ in range(1000)]
    assert drawn.count("c") == 0
    assert drawn.count("a") / 1000 == pytest.approx(0.75, abs=0.05)


@pytest.mark.parametrize(
    "bad",
    [
        {"shrub_height": (2.0, 1.0, 3.0)},
        {"shrub_height": (0.0, 1.0, 3.0)},
        {"shrub_habits": {"mounded": -1.0}},
        {"shrub_habits": {}},
        {"shrub_habits": {"cubic": 1.0}},
        {"nonsense": 1},
    ],
)
def test_bad_settings_are_refused_in_one_line(bad):
    with pytest.raises(ConfigError) as caught:
        PlantsConfig.from_dict(bad)
    assert "\n" not in str(caught.value)
    assert next(iter(bad)) in str(caught.value)


def test_settings_survive_json():
    config = PlantsConfig(shrub_habits={"dense": 1.0}, shrub_height=(0.2, 0.3, 0.4))
    assert PlantsConfig.from_dict(config.model_dump(mode="json")) == config


def test_every_setting_is_described():
    assert all(field.description for field in PlantsConfig.model_fields.values())


def test_patches_have_unit_variance_and_assigned_follows_shares():
    xy = np.random.default_rng(1).uniform(0, 400, (20_000, 2))
    assert patches(np.random.default_rng(0), xy, 5.0).std() == pytest.approx(1, abs=0.25)
    kinds = assigned(np.random.default_rng(0), xy, [3.0, 1.0, 0.0], 5.0)
    shares = np.bincount(kinds, minlength=3) / len(xy)
    assert shares[0] > shares[1] > 0.05
    assert shares[2] == 0


@given(st.floats(0, 3), st.floats(0.1, 5))
def test_scatter_keeps_its_number_and_its_rectangle(clumping, density):
    xy = scatter(np.random.default_rng(0), (2, 3), (12, 8), density, clumping=clumping)
    assert len(xy) == round(50 * density)
    assert ((xy >= (2, 3)) & (xy <= (12, 8))).all()


def test_scatter_is_clumpy():
    counts = []
    for clumping in (0.0, 1.5):
        xy = scatter(np.random.default_rng(0), (0, 0), (20, 20), 10, clumping=clumping)
        counts.append(np.histogram2d(*xy.T, bins=10)[0].std())
    assert counts[1] > 2 * counts[0]


def test_pool_grows_few_and_hands_out_many():
    grown = []

    def grow():
        grown.append(1)
        return Plant.of([Surface(box((-1, -1, 0), (1, 1, 2)), BARK)], "bush")

    pool, rng = Pool(grow, 3), np.random.default_rng(0)
    plants = [pool.take(rng) for _ in range(20)]
    assert len(grown) == 3
    assert {plant.class_name for plant in plants} == {"bush"}
    tops = [plant.model[0].mesh.vertices[:, 2].max() for plant in plants]
    np.testing.assert_allclose(tops, [plant.height for plant in plants], rtol=1e-6)
    assert len(set(tops)) > 10
