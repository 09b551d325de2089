"""Grid sub-sampling of a scan that arrives in chunks.

Only voxels are held, never the raw points: each point is added to its voxel's sums, which a hash
table finds by the voxel's key. Where a scratch folder is given, only so many voxels are held either
(:mod:`bushseg.voxel_runs`).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.grid import OUTSIDE, VoxelGrid
from bushseg.key_search import find_sorted
from bushseg.parallel import for_chunks
from bushseg.scratch import Scratch
from bushseg.voxel_runs import Runs
from bushseg.voxel_sums import Sums, add_points, fill_means

MAX_VOXELS = 1 << 21
"""Voxels that are held in memory, where a scratch folder can take the others."""

_NO_LIMIT = 1 << 31  # a table's slots hold int32
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
        scratch: Made these arrays, in memory or in files; what else has a row a voxel it makes too.
    """

    grid: VoxelGrid
    keys: NDArray[np.int64]
    xyz: NDArray[np.float64]
    values: dict[str, NDArray[np.float32]]
    counts: NDArray[np.int64]
    labels: NDArray[np.int16] | None = None
    scratch: Scratch = field(default_factory=Scratch)

    def __len__(self) -> int:
        return len(self.keys)

    def find(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """The voxel of each key: the join from raw points back to voxels.

        Args:
            keys: Morton keys, shape (M,), int64.

        Returns:
            Index into the voxels, shape (M,), int64; -1 where no voxel has that key.
        """
        return find_sorted(self.keys, keys)


class GridSubsampler:
    """Accumulates the voxels of a scan, chunk by chunk.

    Args:
        grid: The grid.
        num_classes: How many classes `labels` may name; None where the scan has no labels.
        folder: A scratch folder for voxels that are too many; None holds all in memory.
        max_voxels: Voxels to hold in memory where there is such a folder.
        on_disk: Whether the voxels are to stand in that folder however few they are.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        num_classes: int | None = None,
        folder: Path | None = None,
        max_voxels: int = MAX_VOXELS,
        *,
        on_disk: bool = False,
    ) -> None:
        self.grid = grid
        self.num_classes = num_classes
        self.num_outside = 0
        self._names: list[str] = []
        self._sums: Sums | None = None
        self._num_voxels = 0
        self._folder = folder
        self._limit = _NO_LIMIT if folder is None else max_voxels
        self._runs = Runs(Scratch(folder))
        self._on_disk = on_disk

    @property
    def num_spilled(self) -> int:
        """Voxels that went to disk so far, some of them more than once."""
        return self._runs.num_rows

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

        Raises:
            WriteError: The scratch folder can't hold the voxels.
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
            size = min(max(1, len(keys)), self._limit)
            self._sums = Sums.of_size(size, len(columns), self.num_classes or 0)
        points = np.ascontiguousarray(xyz), columns, np.ascontiguousarray(labels)
        done = 0
        while done < len(keys):
            self._num_voxels, done = add_points(
                self._sums, self._num_voxels, self.grid.origin, keys, *points, done
            )
            if done < len(keys):
                self._make_room(self._sums)

    def _make_room(self, sums: Sums) -> None:
        """For more voxels: a larger table, or an empty one."""
        size = len(sums.keys)
        if size < self._limit:
            self._sums = sums.grown(min(2 * size, self._limit))
        else:
            self._runs.write(sums, self._num_voxels)
            sums.slots.fill(-1)
            self._num_voxels = 0

    def finish(self) -> Voxels:
        """The voxels of all points counted in so far; none at all gives zero voxels.

        Raises:
            WriteError: The scratch folder can't hold them.
        """
        sums, size = self._sums, self._num_voxels
        self._sums = None  # a large table isn't needed any more
        if sums is None or not (size or len(self._runs)):
            empty = np.empty(0, np.int64)
            return Voxels(self.grid, empty, np.empty((0, 3)), {}, empty, None)
        if not len(self._runs):
            table = Sums(sums.slots, *(column[:size] for column in sums.columns))
            scratch = Scratch(self._folder if self._on_disk else None)
            return self._averaged(scratch, size, [table])
        self._runs.write(sums, size)
        # What is merged is held twice, as it was and in order.
        limit = max(1, len(sums.keys) // 2)
        del sums
        voxels = self._averaged(
            Scratch(self._folder), self._runs.count_keys(limit), self._runs.ranges(limit)
        )
        self._runs.remove()
        return voxels

    def _averaged(self, scratch: Scratch, size: int, parts: Iterable[Sums]) -> Voxels:
        """Voxels from sums that come in parts, each of another range of keys, ascending."""
        has_labels = self.num_classes is not None
        keys = scratch.empty("keys", (size,), np.int64)
        counts = scratch.empty("counts", (size,), np.int64)
        xyz = scratch.empty("xyz", (size, 3), np.float64)
        values = scratch.empty("values", (len(self._names), size), np.float32)
        labels = scratch.empty("labels", (size if has_labels else 0,), np.int16)
        done = 0
        for sums in parts:
            order = np.argsort(sums.keys, kind="stable")  # quick where parts of it are in order
            ordered = sums.keys[order]
            starts = np.append(np.flatnonzero(np.diff(ordered, prepend=-1)), len(ordered))
            keys[done : done + len(starts) - 1] = ordered[starts[:-1]]
            average = partial(fill_means, sums, order, starts, counts, xyz, values, labels, done)
            for_chunks(average, len(starts) - 1, _CHUNK)
            done += len(starts) - 1
            scratch.release()
        return Voxels(
            grid=self.grid,
            keys=keys,
            xyz=xyz,
            values=dict(zip(self._names, values, strict=True)),
            counts=counts,
            labels=labels if has_labels else None,
            scratch=scratch,
        )
