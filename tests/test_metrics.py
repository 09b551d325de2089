"""The scores, against hand-worked values and a plain loop over the points."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from bushseg.errors import DataError
from bushseg.metrics import ConfusionMatrix

NAN = math.nan


def confusion(predictions: list[int], labels: list[int], num_classes: int) -> ConfusionMatrix:
    matrix = ConfusionMatrix(num_classes)
    matrix.update(np.array(predictions, np.int16), np.array(labels, np.int16))
    return matrix


def test_hand_worked_scores() -> None:
    # Class 0: 2 of 3 found, one false alarm. Class 1: 1 of 2. Class 2 nowhere. One unlabelled.
    matrix = confusion([0, 0, 1, 1, 0, 1], [0, 0, 0, 1, 1, -1], 3)
    assert matrix.counts.tolist() == [[2, 1, 0], [1, 1, 0], [0, 0, 0]]
    assert matrix.counts.dtype == np.int64
    assert matrix.support.tolist() == [3, 2, 0]
    assert matrix.predicted.tolist() == [3, 2, 0]
    assert_allclose(matrix.iou, [2 / 4, 1 / 3, NAN])
    assert_allclose(matrix.miou, (2 / 4 + 1 / 3) / 2)
    assert_allclose(matrix.oa, 3 / 5)
    assert_allclose(matrix.precision, [2 / 3, 1 / 2, NAN])
    assert_allclose(matrix.recall, [2 / 3, 1 / 2, NAN])
    assert_allclose(matrix.f1, [4 / 6, 2 / 4, NAN])


def test_a_missing_prediction_is_a_miss() -> None:
    matrix = confusion([0, -1, -1], [0, 0, -1], 2)
    assert matrix.missed.tolist() == [1, 0]
    assert matrix.support.tolist() == [2, 0]
    assert_allclose(matrix.oa, 0.5)
    assert_allclose(matrix.iou, [0.5, NAN])
    assert_allclose(matrix.recall, [0.5, NAN])
    assert_allclose(matrix.precision, [1, NAN])


def test_a_class_only_predicted_counts_with_zero() -> None:
    matrix = confusion([0, 1], [0, 0], 2)
    assert_allclose(matrix.iou, [0.5, 0])
    assert_allclose(matrix.miou, 0.25)
    assert_allclose(matrix.recall, [0.5, NAN])


def test_no_points_give_nan() -> None:
    for matrix in (ConfusionMatrix(2), confusion([0, 1], [-1, -1], 2)):
        assert math.isnan(matrix.miou)
        assert math.isnan(matrix.oa)
        assert np.isnan(matrix.f1).all()


def test_updates_and_sums_agree() -> None:
    first, second = confusion([0, -1], [1, 1], 2), confusion([1, 1], [1, 0], 2)
    total = first + second
    assert total.counts.tolist() == [[0, 1], [1, 1]]
    assert total.missed.tolist() == [0, 1]
    first.update(np.array([1, 1]), np.array([1, 0]))
    assert first.counts.tolist() == total.counts.tolist()
    with pytest.raises(ValueError, match="of 2 and 3 classes"):
        first + ConfusionMatrix(3)


def test_every_integer_dtype_counts() -> None:
    for dtype in (np.uint8, np.uint64, np.int8, np.int64):
        matrix = ConfusionMatrix(2)
        matrix.update(np.array([0, 1, 1], dtype), np.array([0, 0, 1], dtype))
        assert matrix.counts.tolist() == [[1, 1], [0, 1]]


@pytest.mark.parametrize(
    ("predictions", "labels", "message"),
    [
        ([2], [0], "prediction 2 is no class; expected -1 .. 1"),
        ([-2], [0], "prediction -2"),
        ([0], [2], "label 2"),
        ([0], [-3], "label -3"),
        ([0, 1], [0], r"shape \(2,\) and labels \(1,\)"),
    ],
)
def test_what_is_no_class_is_refused(
    predictions: list[int], labels: list[int], message: str
) -> None:
    with pytest.raises(DataError, match=message):
        confusion(predictions, labels, 2)


def test_no_classes_are_refused() -> None:
    with pytest.raises(ValueError, match="num_classes is 0"):
        ConfusionMatrix(0)


@given(st.lists(st.tuples(st.integers(-1, 3), st.integers(-1, 3)), max_size=60))
def test_scores_equal_a_plain_loop(points: list[tuple[int, int]]) -> None:
    matrix = confusion([p for p, _ in points], [t for _, t in points], 4)
    labelled = [(p, t) for p, t in points if t != -1]
    ious = []
    for k in range(4):
        both = sum(p == k and t == k for p, t in labelled)
        either = sum(p == k or t == k for p, t in labelled)
        predicted = sum(p == k for p, _ in labelled)
        support = sum(t == k for _, t in labelled)
        iou = both / either if either else NAN
        precision = both / predicted if predicted else NAN
        recall = both / support if support else NAN
        ious.append(iou)
        assert_allclose(matrix.iou[k], iou)
        assert_allclose(matrix.precision[k], precision)
        assert_allclose(matrix.recall[k], recall)
        assert matrix.support[k] == support
        if both:
            assert_allclose(matrix.f1[k], 2 * precision * recall / (precision + recall))
        else:
            assert_allclose(matrix.f1[k], 0 if either else NAN)
    present = [iou for iou in ious if not math.isnan(iou)]
    assert_allclose(matrix.miou, sum(present) / len(present) if present else NAN)
    right = sum(p == t for p, t in labelled)
    assert_allclose(matrix.oa, right / len(labelled) if labelled else NAN)
