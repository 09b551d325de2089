"""Sums of points by voxel, as compiled loops: what grid sub-sampling adds up and divides."""

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.key_table import empty_slots, place, slot_of


class Sums(NamedTuple):
    """Sums of each voxel, a row a voxel.

    Attributes:
        slots: Which row a key has, see :mod:`bushseg.key_table`; empty where nobody asks.
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

    @property
    def columns(self) -> list[NDArray[Any]]:
        """All but the slots: what has a row a voxel."""
        return [self.keys, self.counts, self.positions, self.values, self.votes]

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

    def grown(self, size: int) -> Self:
        """The same voxels with room for so many."""
        room = self.of_size(size, self.values.shape[1], self.votes.shape[1])
        place(room.slots, self.keys)
        for old, new in zip(self.columns, room.columns, strict=True):
            new[: len(old)] = old
        return room


@compiled
def add_points(
    sums: Sums,
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
def fill_means(
    sums: Sums,
    order: NDArray[np.int64],
    starts: NDArray[np.int64],
    counts: NDArray[np.int64],
    xyz: NDArray[np.float64],
    values: NDArray[np.float32],
    labels: NDArray[np.int16],
    shift: int,
    first: int,
    stop: int,
) -> None:
    """Write counts, means and majorities of some voxels.

    Args:
        sums: A voxel may have several rows.
        order: Rows by voxel.
        starts: Where each voxel's rows begin in `order`, and where the last ones end.
        counts: Points, shape (N,), int64; filled.
        xyz: Mean positions, shape (N, 3), float64; filled.
        values: Mean attributes, shape (V, N), float32; filled.
        labels: Majority class, -1 for none, shape (N,), or (0,) without labels, int16; filled.
        shift: Where the first voxel of `starts` goes.
        first: First voxel, counted in `starts`.
        stop: Voxel after the last.
    """
    num_values, num_classes = sums.values.shape[1], sums.votes.shape[1]
    means, votes = np.empty(num_values), np.empty(num_classes, np.int64)
    for voxel in range(first, stop):
        i = shift + voxel
        count, x, y, z = 0, 0.0, 0.0, 0.0
        means[:], votes[:] = 0, 0
        for row in order[starts[voxel] : starts[voxel + 1]]:
            count += sums.counts[row]
            x += sums.positions[row, 0]
            y += sums.positions[row, 1]
            z += sums.positions[row, 2]
            for index in range(num_values):
                means[index] += sums.values[row, index]
            for label in range(num_classes):
                votes[label] += sums.votes[row, label]
        counts[i] = count
        xyz[i, 0], xyz[i, 1], xyz[i, 2] = x / count, y / count, z / count
        for index in range(num_values):
            values[index, i] = means[index] / count
        if len(labels):
            labels[i], most = -1, 0
            for label in range(num_classes):
                if votes[label] > most:
                    labels[i], most = label, votes[label]
