import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.figures import PRESETS
from bushseg.simulation.sensors.variety import CHOICES, SPANS, varied


def test_every_kind_varies():
    assert list(SPANS) == list(CHOICES) == list(PRESETS)


@given(st.sampled_from(list(PRESETS)), st.integers(0, 2**32))
def test_figures_stay_within_their_spans(kind, seed):
    config = varied(np.random.default_rng(seed), SensorConfig(kind=kind))
    figures, preset = config.figures, PRESETS[kind]
    for name, (low, high) in SPANS[kind].items():
        scale = 1.0
        if (kind, name) == ("airborne", "reach"):
            scale = figures.flight_height / preset.flight_height
        assert low * (1 - 1e-9) <= getattr(figures, name) / scale <= high * (1 + 1e-9)
    for name, options in CHOICES[kind].items():
        assert getattr(config, name) in options


@pytest.mark.parametrize("kind", PRESETS)
def test_the_preset_is_within_the_spans(kind):
    figures = SensorConfig(kind=kind).figures
    for name, (low, high) in SPANS[kind].items():
        assert low <= getattr(figures, name) <= high, name


def test_what_is_given_stays_and_changes_no_other_draw():
    def draw(**settings):
        return varied(np.random.default_rng(4), SensorConfig(kind="airborne", **settings))

    free, bound = draw(), draw(overlap=0.2)
    assert bound.overlap == 0.2
    assert bound == free.model_copy(update={"overlap": 0.2})


def test_who_flies_higher_sees_farther():
    low, high = (
        varied(np.random.default_rng(4), SensorConfig(kind="airborne", flight_height=height))
        for height in (400.0, 1200.0)
    )
    assert high.figures.reach == pytest.approx(3 * low.figures.reach)
