"""Grid sub-sampling of a scan that arrives in chunks.

Only voxels are held, never the raw points: each chunk is reduced to per-voxel sums, and the sums of
chunks are merged whenever they outgrow what they merge into.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.grid import OUTSIDE, VoxelGrid

_MERGE_ROWS = 4_000_000


@dataclass(frozen=True, slots=True)
class Voxels:
    """The occupied voxels of a scan, in Morton order.

    Attributes:
        grid: The grid they lie in.
        keys: Morton keys, ascending and unique, shape (N,), int64.
        xyz: Mean position of a voxel's points, metres from the grid's origin, (N, 3), float64.
        values: Mean of each attribute that was asked for, name to (N,) float32.
        counts: Raw points in the voxel, shape (N,), int64.
        labels: Majority class index, -1 where no point is labelled, (N,) int16. A tie goes to the
            lower index, an unlabelled point has no vote. None where the scan has no labels.
    """

    grid: VoxelGrid
    keys: NDArray[np.int64]
    xyz: NDArray[np.float64]
    values: dict[str, NDArray[np.float32]]
    counts: NDArray[np.int64]
    labels: NDArray[np.int16] | None = None

    def __len__(self) -> int:
        return len(self.keys)

    def find(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """The voxel of each key: the join from raw points back to voxels.

        Args:
            keys: Morton keys, shape (M,), int64.

        Returns:
            Index into the voxels, shape (M,), int64; -1 where no voxel has that key.
        """
        if not len(self.keys):
            return np.full(len(keys), -1)
        # Scans are written along the scanner's sweep: consecutive points often share a voxel.
        starts = _run_starts(keys)
        found = np.searchsorted(self.keys, keys[starts])
        found[found == len(self.keys)] = 0
        found[self.keys[found] != keys[starts]] = -1
        return np.repeat(found, np.diff(np.append(starts, len(keys))))


class GridSubsampler:
    """Accumulates the voxels of a scan, chunk by chunk.

    Args:
        grid: The grid.
        num_classes: How many classes `labels` may name; None where the scan has no labels.
    """

    def __init__(self, grid: VoxelGrid, num_classes: int | None = None) -> None:
        self.grid = grid
        self.num_classes = num_classes
        self.num_outside = 0
        self._names: list[str] = []
        self._merged: _Sums | None = None
        self._pending: list[_Sums] = []

    def add(
        self,
        xyz: NDArray[np.float64],
        values: Mapping[str, NDArray[np.float32]],
        labels: NDArray[np.int16] | None = None,
    ) -> None:
        """Count a chunk of points in.

        Args:
            xyz: Coordinates in metres, shape (N, 3), float64. Points without a voxel (not finite,
                out of reach) are counted in `num_outside` and left out.
            values: Attributes to average, name to (N,) float32; the same names each time.
            labels: Class indices, -1 for unlabelled, shape (N,); required with `num_classes`.
        """
        keys = self.grid.keys(xyz)
        inside = keys != OUTSIDE
        if not inside.all():
            self.num_outside += int(np.count_nonzero(~inside))
            keys, xyz = keys[inside], xyz[inside]
            values = {name: column[inside] for name, column in values.items()}
            labels = None if labels is None else labels[inside]
        if not len(keys):
            return
        # One table of all columns to be summed: position, then the attributes in sorted order.
        names = sorted(values)
        columns = np.column_stack([xyz - self.grid.origin, *(values[name] for name in names)])
        votes = None
        if self.num_classes is not None and labels is not None:
            votes = np.zeros((len(keys), self.num_classes), dtype=np.int32)
            known = np.flatnonzero(labels >= 0)
            votes[known, labels[known]] = 1
        self._names = names
        self._pending.append(_Sums(keys, columns, np.ones(len(keys), np.int64), votes).reduced())
        rows = sum(len(sums.keys) for sums in self._pending)
        if rows > max(_MERGE_ROWS, len(self._merged.keys) if self._merged else 0):
            self._merge()

    def finish(self) -> Voxels:
        """The voxels of all points counted in so far; none at all gives zero voxels."""
        self._merge()
        sums = self._merged
        if sums is None:
            empty = np.empty(0, np.int64)
            return Voxels(self.grid, empty, np.empty((0, 3)), {}, empty, None)
        means = sums.columns / sums.counts[:, None]
        values = {
            name: means[:, 3 + index].astype(np.float32) for index, name in enumerate(self._names)
        }
        labels = None
        if sums.votes is not None:
            labels = sums.votes.argmax(axis=1).astype(np.int16)
            labels[~sums.votes.any(axis=1)] = -1
        xyz = np.ascontiguousarray(means[:, :3])
        return Voxels(self.grid, sums.keys, xyz, values, sums.counts, labels)

    def _merge(self) -> None:
        parts = ([self._merged] if self._merged else []) + self._pending
        self._pending = []
        if len(parts) == 1:
            self._merged = parts[0]
        elif parts:
            self._merged = _Sums.concatenated(parts).reduced()


@dataclass(frozen=True, slots=True)
class _Sums:
    """Sums by key; after `reduced` the keys are ascending and unique."""

    keys: NDArray[np.int64]
    columns: NDArray[np.float64]
    counts: NDArray[np.int64]
    votes: NDArray[np.int32] | None

    @staticmethod
    def concatenated(parts: "list[_Sums]") -> "_Sums":
        votes = [part.votes for part in parts if part.votes is not None]
        return _Sums(
            np.concatenate([part.keys for part in parts]),
            np.concatenate([part.columns for part in parts]),
            np.concatenate([part.counts for part in parts]),
            np.concatenate(votes) if votes else None,
        )

    def reduced(self) -> "_Sums":
        order = np.argsort(self.keys, kind="stable")
        keys = self.keys[order]
        starts = _run_starts(keys)
        return _Sums(
            keys[starts],
            np.add.reduceat(self.columns[order], starts, axis=0),
            np.add.reduceat(self.counts[order], starts),
            None if self.votes is None else np.add.reduceat(self.votes[order], starts, axis=0),
        )


def _run_starts(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where each run of equal keys begins."""
    return np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]])[: len(keys)])
