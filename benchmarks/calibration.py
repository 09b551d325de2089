"""Whether probabilities mean what they say: reliability and its one-number summary, ECE.

Guo et al., "On Calibration of Modern Neural Networks", 2017: confidences are binned, and in each
bin the mean confidence is compared with the share of points that are right.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NUM_BINS = 15


@dataclass(frozen=True)
class Reliability:
    """Confidences against the truth, in bins of equal width from 0 to 1.

    Attributes:
        counts: Points in each bin, (B,) int64.
        confidence: Their mean confidence, (B,) float64; NaN in empty bins.
        accuracy: The share of them that are right, (B,) float64; NaN in empty bins.
    """

    counts: NDArray[np.int64]
    confidence: NDArray[np.float64]
    accuracy: NDArray[np.float64]

    @property
    def ece(self) -> float:
        """Expected calibration error: the mean gap of the bins, weighted by their points."""
        if not self.counts.sum():
            return float("nan")
        gaps = np.abs(self.confidence - self.accuracy)
        return float(np.nansum(gaps * self.counts) / self.counts.sum())


def reliability(
    confidence: NDArray[np.float32], right: NDArray[np.bool_], num_bins: int = NUM_BINS
) -> Reliability:
    """Bin confidences.

    Args:
        confidence: In 0 .. 1, shape (N,), float32.
        right: Whether what was so confidently said is true, shape (N,), bool.
        num_bins: B.
    """
    bins = np.minimum((confidence * num_bins).astype(np.intp), num_bins - 1)
    counts = np.bincount(bins, minlength=num_bins)
    sums, hits = (
        np.bincount(bins, weights=values.astype(np.float64), minlength=num_bins)
        for values in (confidence, right)
    )
    with np.errstate(invalid="ignore"):
        return Reliability(counts, sums / counts, hits / counts)
