import pytest
from pydantic import ValidationError

from bushseg.simulation import SimulateConfig


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("num_sites", 0),
        ("seed", -1),
        ("size", 3.0),
        ("size", float("nan")),
        ("num_bushes", -1),
        ("num_trees", 1.5),
        ("sensor", "sonar"),
        ("sensor", {"stations": 0}),
        ("bushes", 12),
    ],
)
def test_nonsense_is_refused_by_name(setting, value):
    with pytest.raises(ValidationError, match=setting):
        SimulateConfig.model_validate({setting: value})


def test_settings_are_frozen_and_described():
    with pytest.raises(ValidationError, match="frozen"):
        SimulateConfig().seed = 3
    assert all(field.description for field in SimulateConfig.model_fields.values())
