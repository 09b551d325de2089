"""Confidence that means something: a temperature for logits, and how far confidence is off.

A network trained to be right is surer than it is right. Dividing its logits by one number, fitted
on data it has not learnt from, mends most of that and changes no label (Guo et al., "On calibration
of modern neural networks", 2017).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

NUM_BINS = 15
MIN_LABELS = 100
"""Fewer labelled points than these say nothing about a temperature."""

_LIMITS = (0.1, 10.0)  # what can't be fitted (every label right) ends here, not at 0
_HALVINGS = 24


class ConfidenceBins:
    """Points counted by confidence, in bins of equal width: what a reliability diagram shows.

    Attributes:
        counts: Points in each bin, shape (B,), int64.
        correct: How many of them were predicted right, shape (B,), int64.
        confidence: Sum of their confidences, shape (B,), float64.
    """

    def __init__(self, num_bins: int = NUM_BINS) -> None:
        self.counts = np.zeros(num_bins, dtype=np.int64)
        self.correct = np.zeros(num_bins, dtype=np.int64)
        self.confidence = np.zeros(num_bins)

    def update(self, confidence: NDArray[np.floating[Any]], is_correct: NDArray[np.bool_]) -> None:
        """Count more points.

        Args:
            confidence: Probability of the predicted class, shape (N,); what is not in 0 .. 1, NaN
                included, is left out.
            is_correct: Whether the prediction is right, shape (N,).
        """
        confidence = confidence.astype(np.float64)
        known = (confidence >= 0) & (confidence <= 1 + 1e-6)  # not so for NaN
        confidence, is_correct = confidence[known], is_correct[known]
        num_bins = len(self.counts)
        bins = np.minimum((confidence * num_bins).astype(np.intp), num_bins - 1)
        self.counts += np.bincount(bins, minlength=num_bins)
        self.correct += np.bincount(bins[is_correct], minlength=num_bins)
        self.confidence += np.bincount(bins, confidence, num_bins)

    @property
    def error(self) -> float:
        """Expected calibration error: |accuracy - mean confidence| of the bins, by their points.

        A fraction in 0 .. 1; NaN where no point was counted.
        """
        total = self.counts.sum()
        if not total:
            return float("nan")
        return float(np.abs(self.correct - self.confidence).sum() / total)

    @property
    def mean_confidence(self) -> float:
        """Mean confidence of all points; NaN where there is none."""
        total = self.counts.sum()
        return float(self.confidence.sum() / total) if total else float("nan")


def fit_temperature(logits: NDArray[np.float32], labels: NDArray[np.integer[Any]]) -> float:
    """The temperature that makes held-out labels likeliest.

    Their negative log-likelihood is convex in b = 1 / temperature; where its slope, the mean of
    E[z] - z_label under softmax(b z), crosses zero is found by halving.

    Args:
        logits: Class scores z, shape (N, C), float32.
        labels: True classes, -1 for unlabelled, shape (N,).

    Returns:
        What to divide logits by, within 0.1 .. 10; 1 where fewer than `MIN_LABELS` points are
        labelled.
    """
    labelled = labels >= 0
    if np.count_nonzero(labelled) < MIN_LABELS:
        return 1.0
    # Relative to the largest: exp can't overflow.
    scores = logits[labelled] - logits[labelled].max(axis=1, keepdims=True)
    of_label = float(np.take_along_axis(scores, labels[labelled, None].astype(np.intp), 1).mean())
    low, high = 1 / _LIMITS[1], 1 / _LIMITS[0]
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        shares = np.exp(np.float32(middle) * scores)
        expected = (shares * scores).sum(axis=1) / shares.sum(axis=1)
        if float(expected.mean(dtype=np.float64)) < of_label:
            low = middle  # labels score better than chance would have it: surer
        else:
            high = middle
    return float(1 / np.sqrt(low * high))


def confidences(logits: NDArray[np.float32], temperature: float) -> NDArray[np.float32]:
    """The largest of softmax(logits / temperature), (N, C) -> (N,)."""
    scores = (logits - logits.max(axis=1, keepdims=True)) / np.float32(temperature)
    sure: NDArray[np.float32] = 1 / np.exp(scores).sum(axis=1)
    return sure
