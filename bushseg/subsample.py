"""Grid sub-sampling of a scan that arrives in chunks.

Only voxels are held, never the raw points: each point is added to its voxel's sums, which a hash
table finds by the voxel's key.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.grid import OUTSIDE, VoxelGrid
from bushseg.key_table import KeyIndex, empty_slots, place, slot_of
from bushseg.parallel import for_chunks

_CHUNK = 32_768  # voxels a thread takes at a time


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

    def find(self, keys: NDArray[np.int64]) -> NDArray[np.int32]:
        """The voxel of each key: the join from raw points back to voxels.

        Whoever asks more than once keeps a :class:`bushseg.key_table.KeyIndex` of the keys.

        Args:
            keys: Morton keys, shape (M,), int64.

        Returns:
            Index into the voxels, shape (M,), int32; -1 where no voxel has that key.
        """
        return KeyIndex(self.keys).find(keys)


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
        self._sums: _Sums | None = None
        self._num_voxels = 0

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
        self.num_outside += int(np.count_nonzero(keys == OUTSIDE))
        self._names = sorted(values)
        columns = np.empty((len(self._names), len(keys)), dtype=np.float32)
        for column, name in zip(columns, self._names, strict=True):
            column[:] = values[name]
        if self.num_classes is None or labels is None:
            labels = np.empty(0, dtype=np.int16)
        if self._sums is None:
            # Memory is taken as it is used: most chunks have far fewer voxels than points.
            self._sums = _Sums.of_size(max(1, len(keys)), len(columns), self.num_classes or 0)
        points = np.ascontiguousarray(xyz), columns, np.ascontiguousarray(labels)
        done = 0
        while done < len(keys):
            self._num_voxels, done = _add_points(
                self._sums, self._num_voxels, self.grid.origin, keys, *points, done
            )
            if done < len(keys):
                self._sums = self._sums.doubled()

    def finish(self) -> Voxels:
        """The voxels of all points counted in so far; none at all gives zero voxels."""
        size, sums = self._num_voxels, self._sums
        if sums is None or not size:
            empty = np.empty(0, np.int64)
            return Voxels(self.grid, empty, np.empty((0, 3)), {}, empty, None)
        order = np.argsort(sums.keys[:size])
        xyz = np.empty((size, 3))
        values = np.empty((len(self._names), size), dtype=np.float32)
        labels = np.empty(size if self.num_classes is not None else 0, dtype=np.int16)
        for_chunks(
            lambda start, stop: _average(sums, order, xyz, values, labels, start, stop),
            size,
            _CHUNK,
        )
        return Voxels(
            grid=self.grid,
            keys=sums.keys[order],
            xyz=xyz,
            values=dict(zip(self._names, values, strict=True)),
            counts=sums.counts[order],
            labels=labels if self.num_classes is not None else None,
        )


class _Sums(NamedTuple):
    """Sums of each voxel, a row a voxel, in the order in which they were met.

    Attributes:
        slots: Which row a key has, see :mod:`bushseg.key_table`.
        keys: Morton keys, shape (R,), int64; R is how many voxels there is room for.
        counts: Points, shape (R,), int64.
        positions: Sum of positions relative to the grid's origin, shape (R, 3), float64.
        values: Sums of attributes, shape (R, V), float64.
        votes: Points by class, shape (R, C), int32.
    """

    slots: NDArray[np.int32]
    keys: NDArray[np.int64]
    counts: NDArray[np.int64]
    positions: NDArray[np.float64]
    values: NDArray[np.float64]
    votes: NDArray[np.int32]

    @classmethod
    def of_size(cls, size: int, num_values: int, num_classes: int) -> Self:
        """Room for so many voxels, and none of them there."""
        return cls(
            slots=empty_slots(size),
            keys=np.empty(size, np.int64),
            counts=np.empty(size, np.int64),
            positions=np.empty((size, 3)),
            values=np.empty((size, num_values)),
            votes=np.empty((size, num_classes), np.int32),
        )

    def doubled(self) -> Self:
        """The same voxels with room for as many more."""
        size = len(self.keys)
        room = self.of_size(2 * size, self.values.shape[1], self.votes.shape[1])
        place(room.slots, self.keys)
        room.keys[:size], room.counts[:size] = self.keys, self.counts
        room.positions[:size], room.values[:size] = self.positions, self.values
        room.votes[:size] = self.votes
        return room


@compiled
def _add_points(
    sums: _Sums,
    num_voxels: int,
    origin: NDArray[np.float64],
    keys: NDArray[np.int64],
    xyz: NDArray[np.float64],
    values: NDArray[np.float32],
    labels: NDArray[np.int16],
    start: int,
) -> tuple[int, int]:
    """Add points from `start` on, until there is no room for a new voxel.

    Args:
        sums: What is added to.
        num_voxels: Rows of it that are taken.
        origin: The grid's, shape (3,), float64.
        keys: Each point's voxel, shape (N,), int64; negative for none.
        xyz: Coordinates, shape (N, 3), float64.
        values: Attributes, shape (V, N), float32.
        labels: Class indices, shape (N,) or, without labels, (0,), int16.
        start: First point.

    Returns:
        Voxels there are now, and the first point that wasn't added.
    """
    last, row = np.int64(-1), 0
    for i in range(start, len(keys)):
        key = keys[i]
        if key < 0:
            continue
        if key != last:  # points that follow each other in a scan often share a voxel
            slot = slot_of(sums.slots, sums.keys, key)
            row = sums.slots[slot]
            if row < 0:
                if num_voxels == len(sums.keys):
                    return num_voxels, i
                row, num_voxels = num_voxels, num_voxels + 1
                sums.slots[slot], sums.keys[row], sums.counts[row] = row, key, 0
                sums.positions[row], sums.values[row], sums.votes[row] = 0, 0, 0
            last = key
        sums.counts[row] += 1
        for axis in range(3):
            sums.positions[row, axis] += xyz[i, axis] - origin[axis]
        for index in range(len(values)):
            sums.values[row, index] += values[index, i]
        if len(labels) and labels[i] >= 0:
            sums.votes[row, labels[i]] += 1
    return num_voxels, len(keys)


@compiled
def _average(
    sums: _Sums,
    order: NDArray[np.int64],
    xyz: NDArray[np.float64],
    values: NDArray[np.float32],
    labels: NDArray[np.int16],
    start: int,
    stop: int,
) -> None:
    """Write means and majorities of voxels start to stop; the i-th voxel is row order[i]."""
    for i in range(start, stop):
        row = order[i]
        count = sums.counts[row]
        for axis in range(3):
            xyz[i, axis] = sums.positions[row, axis] / count
        for index in range(len(values)):
            values[index, i] = sums.values[row, index] / count
        if len(labels):
            labels[i], most = -1, 0
            for label in range(sums.votes.shape[1]):
                if sums.votes[row, label] > most:
                    labels[i], most = label, sums.votes[row, label]
