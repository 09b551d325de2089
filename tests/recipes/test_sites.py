"""The sites that teach and those that judge."""

from itertools import chain

import pytest

from bushseg.config import Config


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
    assert all(config.sensor.vary and config.place == "mixed" for config in (*training, *test))


def test_every_model_has_settings(recipe_module, request):
    for name in recipe_module("sites").TRAINING:
        config = Config.load(request.config.rootpath / "recipes" / f"{name}.toml")
        assert len(config.network.widths) == config.prepare.num_levels
