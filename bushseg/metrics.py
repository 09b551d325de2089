"""How well predictions agree with labels: the confusion matrix and what follows from it."""

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bushseg.codes import UNLABELLED, check_labels
from bushseg.errors import DataError

FloatArray = NDArray[np.float64]
CountArray = NDArray[np.int64]


class ConfusionMatrix:
    """Counts of points by true and predicted class, and the scores they give.

    Points without a label (-1) are ignored. A labelled point without a prediction (-1) is a miss:
    it counts against its class and against the overall accuracy, so that a method gains nothing by
    leaving points out.

    Every score is a fraction in 0 .. 1, or NaN where it is undefined: the IoU and F1 of a class
    found neither in the labels nor in the predictions, the precision of one never predicted, the
    recall of one without labels.

    Attributes:
        counts: Shape (C, C), int64; rows are true classes, columns predicted ones.
        missed: Shape (C,), int64; labelled points of each class that have no prediction.
    """

    def __init__(self, num_classes: int) -> None:
        if num_classes < 1:
            raise ValueError(f"num_classes is {num_classes}; expected at least 1")
        self.counts: CountArray = np.zeros((num_classes, num_classes), dtype=np.int64)
        self.missed: CountArray = np.zeros(num_classes, dtype=np.int64)

    @property
    def num_classes(self) -> int:
        """How many classes there are, C."""
        return len(self.missed)

    def update(
        self, predictions: NDArray[np.integer[Any]], labels: NDArray[np.integer[Any]]
    ) -> None:
        """Count more points.

        Args:
            predictions: Predicted classes, shape (N,), any integer dtype, -1 for none.
            labels: True classes, shape (N,), any integer dtype, -1 for unlabelled.

        Raises:
            DataError: The shapes differ, or a value is outside -1 .. C-1.
        """
        if predictions.shape != labels.shape or labels.ndim != 1:
            raise DataError(
                f"predictions have shape {predictions.shape} and labels {labels.shape}; "
                "expected one of each for every point"
            )
        check_labels(predictions, self.num_classes, "prediction")
        check_labels(labels, self.num_classes)
        labelled = labels != UNLABELLED
        # Columns are shifted by one: column 0 takes the points without a prediction.
        width = self.num_classes + 1
        rows, columns = (array[labelled].astype(np.intp) for array in (labels, predictions))
        cells = rows * width + columns + 1
        table = np.bincount(cells, minlength=self.num_classes * width).reshape(-1, width)
        self.missed += table[:, 0]
        self.counts += table[:, 1:]

    def __add__(self, other: Self) -> Self:
        if other.num_classes != self.num_classes:
            raise ValueError(
                f"can't add confusion matrices of {self.num_classes} and {other.num_classes} "
                "classes; expected equal numbers"
            )
        total = type(self)(self.num_classes)
        total.counts = self.counts + other.counts
        total.missed = self.missed + other.missed
        return total

    @property
    def support(self) -> CountArray:
        """Labelled points of each class, shape (C,), int64."""
        total: CountArray = self.counts.sum(axis=1) + self.missed
        return total

    @property
    def predicted(self) -> CountArray:
        """Labelled points predicted as each class, shape (C,), int64."""
        total: CountArray = self.counts.sum(axis=0)
        return total

    @property
    def iou(self) -> FloatArray:
        """Intersection over union of each class, shape (C,) (eq. 12)."""
        return _ratio(self._hits, self.support + self.predicted - self._hits)

    @property
    def miou(self) -> float:
        """Mean IoU (eq. 13) over the classes present in the labels or the predictions.

        A class present in neither has no IoU and doesn't count; one that is predicted but never
        labelled counts with 0. NaN where no class is present.
        """
        present = self.iou[~np.isnan(self.iou)]
        return float(present.mean()) if len(present) else float("nan")

    @property
    def oa(self) -> float:
        """Overall accuracy (eq. 14): the share of labelled points that are predicted right."""
        return float(_ratio(self._hits.sum(), self.support.sum()))

    @property
    def precision(self) -> FloatArray:
        """Share of the points predicted as each class that belong to it, shape (C,)."""
        return _ratio(self._hits, self.predicted)

    @property
    def recall(self) -> FloatArray:
        """Share of the points of each class that are found, shape (C,)."""
        return _ratio(self._hits, self.support)

    @property
    def f1(self) -> FloatArray:
        """Harmonic mean of precision and recall of each class, shape (C,)."""
        return _ratio(2 * self._hits, self.support + self.predicted)

    @property
    def _hits(self) -> CountArray:
        return self.counts.diagonal()


def _ratio(part: Any, whole: Any) -> FloatArray:
    """Divide counts; NaN where there is nothing to divide by."""
    ratio = np.full(np.shape(whole), np.nan)
    np.divide(part, whole, out=ratio, where=np.greater(whole, 0))
    return ratio
