"""Tile predictions become one answer per voxel, and voxels give it to their raw points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.subsample import Voxels
from bushseg.tile_labels import TileLabels


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
    """Collects the predictions of a scan's voxels, every one of which must be entered.

    Args:
        voxels: The scan's voxels.
        bush_index: The class whose probability is kept beside the winner's, or None.
    """

    def __init__(self, voxels: Voxels, bush_index: int | None) -> None:
        self._voxels = voxels
        scratch = voxels.scratch
        # One row more: what a point without a voxel finds at index -1.
        size = len(voxels) + 1
        self._labels = scratch.empty("predicted", (size,), np.int16)
        self._confidence = scratch.empty("confidence", (size,), np.float32)
        self._bush = None if bush_index is None else scratch.empty("bush", (size,), np.float32)
        self._labels[-1], self._confidence[-1] = -1, 0
        if self._bush is not None:
            self._bush[-1] = 0

    def add(self, indices: NDArray[np.int64], tile: TileLabels) -> None:
        """Enter the labels of a tile's core, whose voxels have these indices."""
        self._labels[indices], self._confidence[indices] = tile.labels, tile.confidence
        if self._bush is not None and tile.bush is not None:
            self._bush[indices] = tile.bush
        self._voxels.scratch.release()

    def at(self, xyz: NDArray[np.float64]) -> PointPredictions:
        """The predictions of raw points, through the keys of their voxels.

        Args:
            xyz: Coordinates as the scan was read, shape (N, 3), float64.
        """
        found = self._voxels.find(self._voxels.grid.keys(xyz))
        predictions = PointPredictions(
            labels=self._labels[found],
            confidence=self._confidence[found],
            bush_probability=None if self._bush is None else self._bush[found],
        )
        self._voxels.scratch.release()
        return predictions

    def mean_confidence(self) -> float:
        """Mean confidence of all voxels, once they are entered."""
        values, size = self._confidence, len(self._voxels)
        parts = self._voxels.scratch.blocks(size)
        return sum(float(values[rows].sum(dtype=np.float64)) for rows in parts) / size
