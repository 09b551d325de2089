"""Tiles: upright boxes of about equal point count, with a halo of context.

A scan is cut in x and y along blocks of 16 x 16 voxels, each split at the median of what it holds,
so that a dense spot under a scanner and an empty field give tiles that cost the same. A voxel lies
in the core of exactly one tile; the halo lends a tile's border the neighbors it would have had.
"""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.grid import BLOCK, BLOCK_BITS, decode_morton
from bushseg.scratch import Scratch, blocks

_CUBES, _COLUMNS = "cubes", "columns"

_SMALL_CORE = 10_000
"""Voxels of a core that isn't cut for its halo's sake: more of them would be little but halo."""

_MOST_BLOCKS = 1 << 20
"""Blocks that are listed in memory, 100 bytes each: 3 square kilometres at voxels of 0.1 m."""


@dataclass(frozen=True, slots=True)
class Tile:
    """A rectangle of blocks.

    Attributes:
        low: First block in x and y.
        high: Block after the last in x and y.
        num_points: Voxels in the core.
    """

    low: tuple[int, int]
    high: tuple[int, int]
    num_points: int


class Tiling:
    """Cuts voxels into tiles and finds each tile's voxels without scanning them all.

    Args:
        keys: Morton keys of the voxels, ascending, shape (N,), int64.
        tile_points: A core holds at most so many voxels, unless a single block holds more.
        halo: Context on each side, in voxels; rounded up to whole blocks.
        scratch: Makes the index; None for memory.
        most: A core with its halo holds at most so many, unless the core is small already. None for
            any number: how much halo a tile has depends on how the voxels lie.
    """

    def __init__(
        self,
        keys: NDArray[np.int64],
        tile_points: int,
        halo: int,
        scratch: Scratch | None = None,
        most: int | None = None,
    ) -> None:
        scratch = scratch or Scratch()
        # Voxels of one cube of 16 follow each other in Morton order: cubes are handled, not voxels.
        num_cubes, last = 0, -1
        for rows in scratch.blocks(len(keys)):
            num_cubes, last = num_cubes + _count_cubes(keys[rows], last), int(keys[rows][-1])
        self._bounds = scratch.empty(_CUBES, (num_cubes + 1,), np.int64)
        self._columns = scratch.empty(_COLUMNS, (num_cubes, 2), np.int32)
        done, last = 0, -1
        for rows in blocks(len(keys)):
            found = _list_cubes(keys[rows], last, rows.start, self._bounds[done:])
            cubes = keys[self._bounds[done : done + found]] >> (3 * BLOCK_BITS)
            self._columns[done : done + found] = decode_morton(cubes)[:, :2]
            done, last = done + found, int(keys[rows][-1])
            scratch.release()
        self._bounds[done] = len(keys)
        self._cut(tile_points, halo, most)
        scratch.release()

    @classmethod
    def opened(cls, tiles: list[Tile], halo_blocks: int, num_cubes: int, scratch: Scratch) -> Self:
        """A tiling whose index stands in a scratch folder already.

        Raises:
            CacheError: It doesn't.
        """
        tiling = cls.__new__(cls)
        tiling.tiles, tiling.halo_blocks = tiles, halo_blocks
        tiling._bounds = scratch.open(_CUBES, (num_cubes + 1,), np.int64)
        tiling._columns = scratch.open(_COLUMNS, (num_cubes, 2), np.int32)
        return tiling

    def recut(self, tile_points: int, halo: int) -> "Tiling":
        """Other tiles of the same voxels, found by the same index; arguments as above."""
        other = copy(self)
        other._cut(tile_points, halo)
        return other

    def _cut(self, tile_points: int, halo: int, most: int | None = None) -> None:
        """Choose the tiles."""
        self.halo_blocks = -(-halo // BLOCK)
        columns, sizes, shift = self._gather_blocks()

        def is_small(members: NDArray[np.int64]) -> bool:
            count = sizes[members].sum()
            if most is None or count > tile_points or count <= _SMALL_CORE:
                return bool(count <= tile_points)
            return self.size(_tile(columns, sizes, members, shift)) <= most

        parts = _split(columns, sizes, is_small)
        self.tiles = [_tile(columns, sizes, part, shift) for part in parts]

    @property
    def num_cubes(self) -> int:
        """Cubes of 16 voxels' edge that hold any."""
        return len(self._columns)

    def size(self, tile: Tile) -> int:
        """Voxels of a tile's core and halo."""
        return int(_count_members(self._columns, self._bounds, self._outer(tile)))

    def core(self, tile: Tile) -> NDArray[np.int64]:
        """The voxels of a tile's core, as :meth:`members` has them."""
        box = np.array([*tile.low, *tile.high])
        return self._members(box, box)[0]

    def members(self, tile: Tile) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The voxels of a tile's core and halo.

        Returns:
            Indices into the voxels, ascending (so Morton order is kept), shape (M,), int64; and
            whether each lies in the core, shape (M,), bool.
        """
        return self._members(self._outer(tile), np.array([*tile.low, *tile.high]))

    def _outer(self, tile: Tile) -> NDArray[np.int64]:
        """A tile's rectangle of blocks with its halo."""
        reach = self.halo_blocks * np.array([-1, -1, 1, 1])
        return np.array([*tile.low, *tile.high]) + reach

    def _members(
        self, outer: NDArray[np.int64], inner: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The voxels in a rectangle of blocks, and which of them lie in another within it."""
        size = _count_members(self._columns, self._bounds, outer)
        indices, is_core = np.empty(size, np.int64), np.empty(size, np.bool_)
        _fill_members(self._columns, self._bounds, outer, inner, indices, is_core)
        return indices, is_core

    def _gather_blocks(self) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
        """The blocks that hold voxels, shape (B, 2), how many each holds, shape (B,), and a shift.

        Where they are too many to be listed, four count as one, once or again: the blocks listed
        have an edge of 2^shift blocks.
        """
        columns, counts, shift = np.empty(0, np.int64), np.empty(0, np.int64), 0
        for rows in blocks(len(self._columns)):
            part = self._columns[rows].astype(np.int64) >> shift
            here = np.diff(self._bounds[rows.start : rows.stop + 1])
            columns = np.concatenate([columns, part[:, 0] << 32 | part[:, 1]])
            columns, counts = _merged(columns, np.concatenate([counts, here]))
            while len(columns) > _MOST_BLOCKS:
                shift += 1
                halves = columns >> 33 << 32 | (columns & 0xFFFFFFFF) >> 1
                columns, counts = _merged(halves, counts)
        return np.column_stack([columns >> 32, columns & 0xFFFFFFFF]), counts, shift


def _merged(
    columns: NDArray[np.int64], counts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Each of some blocks once, and the sum of its counts."""
    columns, block = np.unique(columns, return_inverse=True)
    return columns, np.bincount(block, counts).astype(np.int64)


def _split(
    columns: NDArray[np.int64],
    sizes: NDArray[np.int64],
    is_small: Callable[[NDArray[np.int64]], bool],
) -> Iterator[NDArray[np.int64]]:
    """Halve a set of blocks, longer side first, until each part is small enough."""
    pending = [np.arange(len(columns))]
    while pending:
        members = pending.pop()
        if not len(members):
            continue
        places = columns[members]
        extent = np.ptp(places, axis=0)
        if not extent.any() or is_small(members):
            yield members
            continue
        axis = int(extent.argmax())
        order = np.argsort(places[:, axis], kind="stable")
        running = np.cumsum(sizes[members[order]])
        middle = places[order[np.searchsorted(running, running[-1] / 2)], axis]
        # The cut lies beside the middle row; both sides must keep at least one row.
        cut = min(max(int(middle) + 1, places[:, axis].min() + 1), places[:, axis].max())
        below = places[:, axis] < cut
        pending += [members[~below], members[below]]


def _tile(
    columns: NDArray[np.int64], sizes: NDArray[np.int64], members: NDArray[np.int64], shift: int
) -> Tile:
    """The tile of some blocks, whose edge is 2^shift."""
    low = columns[members].min(axis=0) << shift
    high = columns[members].max(axis=0) + 1 << shift
    num_points = int(sizes[members].sum())
    return Tile((int(low[0]), int(low[1])), (int(high[0]), int(high[1])), num_points)


@compiled
def _count_cubes(keys: NDArray[np.int64], last: int) -> int:
    """How many cubes begin among some keys; `last` is the key before them, or -1."""
    count, cube = 0, last >> (3 * BLOCK_BITS)
    for i in range(len(keys)):
        count += keys[i] >> (3 * BLOCK_BITS) != cube
        cube = keys[i] >> (3 * BLOCK_BITS)
    return count


@compiled
def _list_cubes(keys: NDArray[np.int64], last: int, first: int, starts: NDArray[np.int64]) -> int:
    """Note where cubes begin, counted from `first`; returns how many do."""
    count, cube = 0, last >> (3 * BLOCK_BITS)
    for i in range(len(keys)):
        if keys[i] >> (3 * BLOCK_BITS) != cube:
            cube = keys[i] >> (3 * BLOCK_BITS)
            starts[count] = first + i
            count += 1
    return count


@compiled
def _within(columns: NDArray[np.int32], cube: int, box: NDArray[np.int64]) -> bool:
    """Whether a cube stands in a rectangle: low x, low y, high x, high y."""
    x, y = columns[cube, 0], columns[cube, 1]
    return x >= box[0] and y >= box[1] and x < box[2] and y < box[3]


@compiled
def _count_members(
    columns: NDArray[np.int32], bounds: NDArray[np.int64], box: NDArray[np.int64]
) -> int:
    """Voxels of the cubes in a rectangle."""
    count = 0
    for cube in range(len(columns)):
        if _within(columns, cube, box):
            count += bounds[cube + 1] - bounds[cube]
    return count


@compiled
def _fill_members(
    columns: NDArray[np.int32],
    bounds: NDArray[np.int64],
    outer: NDArray[np.int64],
    inner: NDArray[np.int64],
    indices: NDArray[np.int64],
    is_core: NDArray[np.bool_],
) -> None:
    """List the voxels of the cubes in a rectangle, and which of them lie in another within it."""
    count = 0
    for cube in range(len(columns)):
        if _within(columns, cube, outer):
            core = _within(columns, cube, inner)
            for voxel in range(bounds[cube], bounds[cube + 1]):
                indices[count], is_core[count] = voxel, core
                count += 1
