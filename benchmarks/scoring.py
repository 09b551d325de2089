"""Scores of what a labeler said: by class, by group of classes, by range, density and height."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from judging import BUSH, BUSH_LABEL, NAMES, Judged
from numpy.typing import NDArray
from real_scans import GROUP_OF, GROUPS, Source

from bushseg.calibration import ConfidenceBins
from bushseg.metrics import ConfusionMatrix


def class_confusion(judged: Judged) -> ConfusionMatrix:
    """Our seven classes against true labels that are our own codes, as simulated scans have."""
    confusion = ConfusionMatrix(len(NAMES))
    confusion.update(judged.predictions, BUSH.encode(judged.codes).labels)
    return confusion


HOME = np.array([GROUPS.index(GROUP_OF[name]) for name in NAMES] + [-1])
"""The group of each of our classes; of -1, which is the last, none."""


def group_labels(judged: Judged, source: Source) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Predicted and true groups of points of a real source, (N,) each; -1 for none."""
    predictions = HOME[judged.predictions]
    labels = np.full(len(judged.codes), -1)
    for code, group in source.groups.items():
        here = judged.codes == code
        labels[here] = GROUPS.index(group)
        for name in source.also_right.get(code, ()):
            predictions[here & (judged.predictions == NAMES.index(name))] = GROUPS.index(group)
    return predictions, labels


def group_confusion(judged: Judged, source: Source) -> ConfusionMatrix:
    """Groups against the true labels of a real source; rows and columns in the order of GROUPS."""
    confusion = ConfusionMatrix(len(GROUPS))
    confusion.update(*group_labels(judged, source))
    return confusion


def group_confidence(
    judged: Judged, source: Source
) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
    """Whether the likeliest class's group is right, and the probability of all its classes.

    Of the points that have a true group.
    """
    predictions, labels = group_labels(judged, source)
    known = labels >= 0
    own = HOME[judged.predictions]
    summed = np.stack(
        [judged.probabilities[:, HOME[:-1] == group].sum(axis=1) for group in range(len(GROUPS))]
    )
    confidence = summed[own, np.arange(len(own))]
    return (predictions == labels)[known], confidence[known]


def reliability(confidence: NDArray[np.float32], is_right: NDArray[np.bool_]) -> ConfidenceBins:
    """Confidences in bins, against how often they were right."""
    bins = ConfidenceBins()
    bins.update(confidence, is_right)
    return bins


def shares(predictions: NDArray[np.int16]) -> NDArray[np.float64]:
    """Share of points called each class, (7,); NaN of no points."""
    if not len(predictions):
        return np.full(len(NAMES), np.nan)
    counts = np.bincount(predictions + 1, minlength=len(NAMES) + 1)[1:]
    share: NDArray[np.float64] = counts / len(predictions)
    return share


@dataclass(frozen=True)
class Band:
    """One interval of a column.

    Attributes:
        low: Its lower end, which belongs to it.
        high: Its upper end, which doesn't.
    """

    low: float
    high: float

    def __str__(self) -> str:
        if np.isinf(self.high):
            return f"{self.low:g} and more"
        return f"to {self.high:g}" if np.isinf(self.low) else f"{self.low:g} to {self.high:g}"

    def mask(self, values: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Which values lie in it."""
        return (values >= self.low) & (values < self.high)


def bands(*edges: float) -> list[Band]:
    """The intervals between edges, and those beyond the first and the last."""
    ends = [-np.inf, *edges, np.inf]
    return [Band(low, high) for low, high in pairwise(ends)]


BANDS = {
    "range": bands(5, 10, 20, 40),
    "density": bands(4, 16, 64, 256),
    "height": bands(0.5, 1.5, 3, 6),
}
"""Intervals by column: metres, points in a cube of 0.5 m, metres."""


def bush_by_band(judged: Judged, column: str) -> list[tuple[Band, int, float, float, float]]:
    """Bush within each interval of a column.

    Returns:
        Interval, points that are bush, precision, recall and IoU.
    """
    is_bush = BUSH.encode(judged.codes).labels == BUSH_LABEL
    is_labelled = BUSH.encode(judged.codes).labels >= 0
    called = (judged.predictions == BUSH_LABEL) & is_labelled
    rows = []
    for band in BANDS[column]:
        here = band.mask(judged.columns[column])
        hits = int(np.count_nonzero(here & is_bush & called))
        true, found = (int(np.count_nonzero(here & mask)) for mask in (is_bush, called))
        rows.append(
            (band, true, _share(hits, found), _share(hits, true), _share(hits, true + found - hits))
        )
    return rows


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
