import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.calibration import ConfidenceBins, confidences, fit_temperature


def draw(rng: np.random.Generator, logits: np.ndarray, temperature: float) -> np.ndarray:
    """Labels that follow softmax(logits / temperature)."""
    shares = np.exp(logits / temperature)
    shares /= shares.sum(axis=1, keepdims=True)
    return (shares.cumsum(axis=1) < rng.random((len(logits), 1))).sum(axis=1)


def test_five_points_by_hand():
    bins = ConfidenceBins(2)
    bins.update(np.array([0.2, 0.4, 0.6, 1.0, np.nan]), np.array([True, False, True, False, True]))
    assert bins.counts.tolist() == [2, 2]
    assert bins.correct.tolist() == [1, 1]
    # |1 - 0.6| and |1 - 1.6| over four points
    assert bins.error == pytest.approx((0.4 + 0.6) / 4)
    assert bins.mean_confidence == pytest.approx(0.55)


def test_nothing_counted():
    assert np.isnan(ConfidenceBins().error)
    assert np.isnan(ConfidenceBins().mean_confidence)


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=30))
def test_counting_in_parts_is_counting_at_once(points):
    confidence, correct = map(np.array, zip(*points, strict=True))
    whole, parts = ConfidenceBins(), ConfidenceBins()
    whole.update(confidence, correct)
    for start in range(0, len(points), 7):
        parts.update(confidence[start : start + 7], correct[start : start + 7])
    assert parts.error == pytest.approx(whole.error)
    assert 0 <= whole.error <= 1


@pytest.mark.parametrize("temperature", [0.5, 1.0, 3.0])
def test_the_temperature_that_labels_were_drawn_with_is_found(temperature):
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 2, (40_000, 5)).astype(np.float32)
    labels = draw(rng, logits, temperature)
    assert fit_temperature(logits, labels) == pytest.approx(temperature, rel=0.03)
    before, after = ConfidenceBins(), ConfidenceBins()
    correct = logits.argmax(axis=1) == labels
    before.update(confidences(logits, 1.0), correct)
    after.update(confidences(logits, fit_temperature(logits, labels)), correct)
    assert after.error < 0.01
    assert (before.error > 0.1) == (temperature != 1.0)


def test_it_minimizes_the_negative_log_likelihood():
    rng = np.random.default_rng(1)
    logits = rng.normal(0, 3, (500, 4)).astype(np.float32)
    labels = draw(rng, logits, 2.0)

    def loss(temperature: float) -> float:
        scores = logits.astype(np.float64) / temperature
        of_labels = scores[np.arange(500), labels]
        return float((np.log(np.exp(scores).sum(axis=1)) - of_labels).mean())

    found = fit_temperature(logits, labels)
    assert loss(found) <= min(map(loss, np.linspace(0.5, 5, 400))) + 1e-6


def test_unlabelled_points_have_no_say():
    rng = np.random.default_rng(2)
    logits = rng.normal(0, 2, (2000, 3)).astype(np.float32)
    labels = draw(rng, logits, 2.0)
    mixed = np.concatenate([labels, np.full(2000, -1)])
    doubled = np.concatenate([logits, 100 * logits])
    assert fit_temperature(doubled, mixed) == fit_temperature(logits, labels)


def test_few_labels_say_nothing():
    assert fit_temperature(np.ones((99, 2), np.float32), np.zeros(99, int)) == 1.0


def test_a_network_that_is_always_right_stays_finite():
    logits = np.tile(np.array([5.0, -5.0], np.float32), (200, 1))
    assert fit_temperature(logits, np.zeros(200, int)) == pytest.approx(0.1, rel=0.01)


def test_confidences_by_hand():
    logits = np.log(np.array([[1, 3], [2, 2]], np.float32))
    np.testing.assert_allclose(confidences(logits, 1.0), [0.75, 0.5], rtol=1e-6)
    np.testing.assert_allclose(confidences(logits, 0.5), [0.9, 0.5], rtol=1e-6)
