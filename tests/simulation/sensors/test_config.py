import pytest
from pydantic import ValidationError

from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.figures import BEAMS, LIDARS, PRESETS


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("kind", "sonar"),
        ("lidar", "hdl-65"),
        ("stations", 0),
        ("frames", 0),
        ("angular_step", 0.0),
        ("sub_rays", 0),
        ("max_range", float("inf")),
        ("range_noise", -0.01),
        ("dropout", 1.0),
        ("beams", 12),
    ],
)
def test_nonsense_is_refused_by_name(setting, value):
    with pytest.raises(ValidationError, match=setting):
        SensorConfig.model_validate({setting: value})


def test_settings_must_fit_each_other():
    with pytest.raises(ValidationError, match="min_range"):
        SensorConfig(min_range=10, max_range=5)
    with pytest.raises(ValidationError, match="lowest_angle"):
        SensorConfig(lowest_angle=70)
    with pytest.raises(ValidationError, match="flight_height"):
        SensorConfig(kind="airborne", flight_height=100, max_range=110)
    with pytest.raises(ValidationError, match="lidar"):
        SensorConfig(kind="airborne", lidar="vlp-16")


def test_settings_are_frozen_and_described():
    with pytest.raises(ValidationError, match="frozen"):
        SensorConfig().kind = "uav"
    assert all(field.description for field in SensorConfig.model_fields.values())


@pytest.mark.parametrize("kind", PRESETS)
def test_what_is_not_given_is_the_kinds(kind):
    config = SensorConfig(kind=kind, dropout=0.25)
    assert config.figures.dropout == 0.25
    assert config.figures.sway == PRESETS[kind].sway


def test_the_lidar_goes_before_the_kind_and_a_setting_before_both():
    figures = SensorConfig(kind="vehicle", lidar="hdl-64e", divergence=1.5).figures
    assert (figures.max_range, figures.divergence) == (120, 1.5)
    assert SensorConfig(kind="vehicle").beams == "hdl-32e"
    assert SensorConfig(kind="uav").beams is None


def test_a_copy_has_figures_of_its_own():
    config = SensorConfig()
    before = config.figures.divergence
    assert config.model_copy(update={"divergence": 9.0}).figures.divergence == 9.0
    assert config.figures.divergence == before


@pytest.mark.parametrize(
    ("lidar", "number", "low", "high"),
    [
        ("vlp-16", 16, -15, 15),
        ("hdl-32e", 32, -30.67, 10.67),
        ("hdl-64e", 64, -24.33, 2),
        ("os1-64", 64, -16.6, 16.6),
        ("os1-128", 128, -22.5, 22.5),
    ],
)
def test_beams_are_as_published(lidar, number, low, high):
    beams = BEAMS[lidar]
    assert (len(beams), beams[0], beams[-1]) == (number, low, high)
    assert (beams[1:] > beams[:-1]).all()
    assert lidar in LIDARS
