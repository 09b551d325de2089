"""The sites that teach and those that judge."""

from itertools import chain

import numpy as np
import pytest

from bushseg.config import Config
from bushseg.simulation.site import make_site


@pytest.fixture
def training(recipe_module):
    folders = recipe_module("sites").TRAINING
    return list(chain.from_iterable(sites.values() for sites in folders.values()))


@pytest.fixture
def test(recipe_module):
    return list(recipe_module("sites").TEST.values())


def test_no_site_that_judges_has_taught(training, test):
    seeds = [config.seed for config in (*training, *test)]
    assert len(set(seeds)) == len(seeds)
    assert all(ours.plants != theirs.plants for ours in test for theirs in training)


def test_every_kind_that_judges_has_been_taught(training, test):
    assert {config.sensor.kind for config in test} <= {config.sensor.kind for config in training}
    assert all(config.sensor.vary for config in (*training, *test))


def places(config):
    """What the sites of a folder are: a site's first draw (see `make_site`)."""
    seeds = (np.random.SeedSequence([config.seed, n]).spawn(2)[0] for n in range(config.num_sites))
    return [config.places.choose(np.random.default_rng(seed)) for seed in seeds]


def test_a_sites_place_is_drawn_first(test):
    config = test[1].model_copy(update={"size": 20.0})
    seed = np.random.SeedSequence([config.seed, 1]).spawn(2)[0]
    assert make_site(np.random.default_rng(seed), config).place == places(config)[1]


def test_every_judging_folder_has_a_street_and_a_green_place(recipe_module, test):
    for config in test:
        drawn = set(places(config))
        assert "street" in drawn
        assert drawn & set(recipe_module("sites").GREEN)


def test_half_of_the_frames_that_teach_are_of_settlements(recipe_module):
    sites = recipe_module("sites")
    frames = [c for c in sites.TRAINING["close"].values() if c.sensor.kind == "spinning"]
    drawn = [place for config in frames for place in places(config)]
    assert sum(place in sites.SETTLED for place in drawn) >= len(drawn) / 2


def test_every_model_has_settings(recipe_module, request):
    for name in recipe_module("sites").TRAINING:
        config = Config.load(request.config.rootpath / "recipes" / f"{name}.toml")
        assert len(config.network.widths) == config.prepare.num_levels
