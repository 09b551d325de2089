"""Tile predictions become one answer per voxel, and voxels give it to their raw points."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.key_table import KeyIndex
from bushseg.labeler import TilePrediction
from bushseg.subsample import Voxels


@dataclass(frozen=True, slots=True)
class PointPredictions:
    """Predictions of raw points.

    Attributes:
        labels: Class index, -1 for a point that no voxel holds, (N,) int16.
        confidence: Probability of that class, (N,) float32.
        bush_probability: Probability of bush, (N,) float32; None where the model has no such class.
    """

    labels: NDArray[np.int16]
    confidence: NDArray[np.float32]
    bush_probability: NDArray[np.float32] | None


class Stitcher:
    """Collects the predictions of a scan's voxels.

    Args:
        voxels: The scan's voxels.
        bush_index: The class whose probability is kept beside the winner's, or None.
    """

    def __init__(self, voxels: Voxels, bush_index: int | None) -> None:
        self._grid, self._index = voxels.grid, KeyIndex(voxels.keys)
        self._bush_index = bush_index
        # One row more: what a point without a voxel finds at index -1.
        size = len(voxels) + 1
        self._labels = np.full(size, -1, dtype=np.int16)
        self._confidence = np.zeros(size, dtype=np.float32)
        self._bush = None if bush_index is None else np.zeros(size, dtype=np.float32)

    def add(self, predictions: Iterable[TilePrediction]) -> None:
        """Enter the predictions of some tiles."""
        for tile in predictions:
            _enter(tile.indices, tile.probabilities, self._labels, self._confidence)
            if self._bush is not None:
                self._bush[tile.indices] = tile.probabilities[:, self._bush_index]

    def at(self, xyz: NDArray[np.float64]) -> PointPredictions:
        """The predictions of raw points, through the keys of their voxels.

        Args:
            xyz: Coordinates as the scan was read, shape (N, 3), float64.
        """
        found = self._index.find(self._grid.keys(xyz))
        return PointPredictions(
            labels=self._labels[found],
            confidence=self._confidence[found],
            bush_probability=None if self._bush is None else self._bush[found],
        )

    def mean_confidence(self) -> float:
        """Mean confidence of all voxels, once they are entered."""
        return float(self._confidence[:-1].mean(dtype=np.float64))


@compiled
def _enter(
    indices: NDArray[np.int64],
    probabilities: NDArray[np.float32],
    labels: NDArray[np.int16],
    confidence: NDArray[np.float32],
) -> None:
    """Enter the likeliest class of some voxels and its probability; of equal ones the first."""
    for i in range(len(indices)):
        best = 0
        for label in range(1, probabilities.shape[1]):
            if probabilities[i, label] > probabilities[i, best]:
                best = label
        labels[indices[i]], confidence[indices[i]] = best, probabilities[i, best]
