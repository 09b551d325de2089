import numpy as np
import pytest

from bushseg.simulation.plants import PlantsConfig, grow_grass, grow_herbs
from bushseg.simulation.plants.herbs import KINDS

CONFIG = PlantsConfig()


class Slope:
    """Ground that rises by a fifth."""

    def height(self, xy):
        return 0.2 * xy[:, 0]


def places(number, seed=0):
    return np.random.default_rng(seed).uniform(0, 20, (number, 2))


def above_ground(model):
    xyz = np.concatenate([mesh.vertices for mesh, _ in model]).astype(float)
    return xyz[:, 2] - Slope().height(xyz)


@pytest.mark.parametrize(
    ("stand", "low", "high"), [("lawn", 0.02, 0.2), ("meadow", 0.1, 1.2), ("tall", 0.4, 2.5)]
)
def test_grass_is_as_high_as_its_stand(stand, low, high):
    model = grow_grass(np.random.default_rng(0), CONFIG, Slope(), places(800), stand)
    top = np.quantile(above_ground(model), 0.98)
    assert low < top < high


def test_blades_are_rooted_on_the_ground():
    (green, _), *_ = grow_grass(np.random.default_rng(0), CONFIG, Slope(), places(500), "lawn")
    root = green.vertices[green.triangles][:, :2].mean(axis=1)
    np.testing.assert_allclose(root[:, 2], 0.2 * root[:, 0] - 0.01, atol=1e-5)


def test_each_tuft_has_its_blades():
    model = grow_grass(np.random.default_rng(0), CONFIG, Slope(), places(300), "lawn")
    assert sum(len(mesh.triangles) for mesh, _ in model) == 300 * CONFIG.grass_blades


def test_some_tufts_are_dry():
    green, dry = grow_grass(np.random.default_rng(0), CONFIG, Slope(), places(1000), "lawn")
    share = len(dry.mesh.triangles) / (len(dry.mesh.triangles) + len(green.mesh.triangles))
    assert share == pytest.approx(CONFIG.dry_grass, abs=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_herbs_stand_on_the_ground_at_their_height(kind):
    model = grow_herbs(np.random.default_rng(0), CONFIG, Slope(), places(200), kind)
    assert len(model) == 1
    heights = above_ground(model)
    assert np.isfinite(heights).all()
    assert heights.min() > -0.4
    assert 0.03 < np.quantile(heights, 0.98) < 2.5


def test_all_herbs_grow_somewhere():
    model = grow_herbs(np.random.default_rng(0), CONFIG, Slope(), places(5000))
    assert len(model) >= 4


def test_nothing_grows_nowhere():
    rng, nowhere = np.random.default_rng(0), np.zeros((0, 2))
    assert grow_grass(rng, CONFIG, Slope(), nowhere) == []
    assert grow_herbs(rng, CONFIG, Slope(), nowhere) == []


def test_a_seed_grows_one_meadow():
    one, same = (
        grow_grass(np.random.default_rng(4), CONFIG, Slope(), places(100))[0].mesh.vertices
        for _ in range(2)
    )
    np.testing.assert_array_equal(one, same)
