import numpy as np
import pytest

from bushseg.simulation.places.config import DEFAULTS
from bushseg.simulation.places.nursery import LEAST_DETAIL, Nursery, _of_site
from bushseg.simulation.plants import PlantsConfig


def amounts(place, seed=0):
    return DEFAULTS[place].drawn(np.random.default_rng(seed))


def test_sites_differ_but_keep_the_settings_on_average():
    config = PlantsConfig()
    drawn = [_of_site(np.random.default_rng(seed), config) for seed in range(400)]
    leafless = np.array([site.tree_leafless for site in drawn])
    assert leafless.mean() == pytest.approx(config.tree_leafless, abs=0.05)
    assert set(np.round(leafless, 3)) == {0.85, round(0.12 * 0.15 / 0.88, 3)}
    assert len({site.shrub_habits["mounded"] for site in drawn}) == 400


def test_a_kind_that_never_grows_stays_away():
    config = PlantsConfig(tree_forms={"cone": 1.0, "pine": 0.0})
    assert _of_site(np.random.default_rng(0), config).tree_forms["pine"] == 0


def test_full_sites_get_less_detail():
    rng, config = np.random.default_rng(0), PlantsConfig()
    small = Nursery(rng, config, amounts("orchard"), 20.0)
    large = Nursery(rng, config, amounts("forest"), 100.0)
    assert small.config.detail == 1
    assert LEAST_DETAIL <= large.config.detail < 0.5


def test_vigor_scales_plants():
    wanted = {**amounts("garden"), "vigor": 2.0}
    tall = Nursery(np.random.default_rng(3), PlantsConfig(), wanted, 20.0).shrub()
    low = Nursery(np.random.default_rng(3), PlantsConfig(), {**wanted, "vigor": 1.0}, 20.0).shrub()
    assert tall.height == pytest.approx(2 * low.height)
