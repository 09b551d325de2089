import tomllib

import pytest
from pydantic import ValidationError

from bushseg.errors import ConfigError
from bushseg.simulation import SimulateConfig
from bushseg.simulation.described import described
from bushseg.simulation.places.config import DEFAULTS, PlaceConfig


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("num_sites", 0),
        ("seed", -1),
        ("size", 3.0),
        ("size", float("nan")),
        ("place", "moon"),
        ("bushes", 12),
    ],
)
def test_nonsense_is_refused_by_name(setting, value):
    with pytest.raises(ValidationError, match=setting):
        SimulateConfig.model_validate({setting: value})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[places.garden]\nshrubs = [9, 2]", "places.garden.shrubs.*least first"),
        ("[places.garden]\nshrubs = [-1, 2]", "places.garden.shrubs"),
        ("[places.garden]\ncacti = [1, 2]", "places.garden.cacti is no known setting"),
        ("[places.moon]\nshrubs = [1, 2]", "places.moon is no known setting.*--show-config"),
        ("[places]\ngarden = 3", "places.garden"),
        ("places = 3", "places"),
        ("[terrain]\nslope = 3", "terrain.slope"),
        ("size = 4", "size is 4"),
        ("place = 'moon'", "place is 'moon'.*garden"),
        ("[sensor]\nkind = 'sonar'", "sensor.kind"),
        ("size = ", "TOML"),
    ],
)
def test_a_bad_file_gives_one_line(tmp_path, text, complaint):
    file = tmp_path / "region.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint) as caught:
        SimulateConfig.load(file)
    assert "region.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_all_weights_zero_is_refused():
    none = {name: {"weight": 0} for name in DEFAULTS}
    with pytest.raises(ValidationError, match="weights"):
        SimulateConfig.model_validate({"places": none})


def test_a_place_keeps_what_is_not_given():
    config = SimulateConfig.model_validate({"places": {"forest": {"rocks": [7, 8]}}})
    assert config.places.forest.rocks == (7, 8)
    assert config.places.forest.trees == DEFAULTS["forest"].trees
    assert config.places.garden == DEFAULTS["garden"]


def test_options_override_the_file(tmp_path):
    file = tmp_path / "region.toml"
    file.write_text("size = 50\nseed = 3\n[sensor]\nkind = 'phase'\nstations = 5\n")
    config = SimulateConfig.load(file, {"seed": 4, "sensor": {"kind": "tripod"}})
    assert (config.size, config.seed) == (50, 4)
    assert (config.sensor.kind, config.sensor.stations) == ("tripod", 5)


def test_what_is_shown_can_be_read_again(tmp_path):
    config = SimulateConfig.model_validate(
        {
            "place": "mixed",
            "places": {"heath": {"weight": 3, "shrubs": [1, 200.5]}},
            "terrain": {"slope": [0, 30]},
            "sensor": {"kind": "uav"},
        }
    )
    text = described(config)
    file = tmp_path / "region.toml"
    file.write_text(text)
    assert SimulateConfig.load(file) == config
    assert SimulateConfig.model_validate(tomllib.loads(config.to_toml())) == config


def test_all_settings_are_shown_with_their_meaning():
    text = described(SimulateConfig())
    for section in ("sensor", "terrain", "plants", "structures", "places.garden", "places.yard"):
        assert f"[{section}]" in text
    for field in PlaceConfig.model_fields.values():
        assert f"# {field.description}\n" in text
    assert text.count("# Shrubs in the open") == 1


def test_settings_are_frozen_and_described():
    with pytest.raises(ValidationError, match="frozen"):
        SimulateConfig().seed = 3
    assert all(field.description for field in PlaceConfig.model_fields.values())
