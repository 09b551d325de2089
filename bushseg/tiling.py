"""Tiles: upright boxes of about equal point count, with a halo of context.

A scan is cut in x and y along blocks of 16 x 16 voxels, each split at the median of what it holds,
so that a dense spot under a scanner and an empty field give tiles that cost the same. A voxel lies
in the core of exactly one tile; the halo lends a tile's border the neighbors it would have had.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.grid import BLOCK, BLOCK_BITS, decode_morton


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
    """

    def __init__(self, keys: NDArray[np.int64], tile_points: int, halo: int) -> None:
        self.halo_blocks = -(-halo // BLOCK)
        # Voxels of one cube of 16 follow each other in Morton order: cubes are handled, not voxels.
        cubes = keys >> (3 * BLOCK_BITS)
        starts = np.flatnonzero(np.diff(cubes, prepend=-1))
        self._bounds = np.append(starts, len(keys))
        self._columns = decode_morton(cubes[starts])[:, :2].astype(np.int64)
        packed = self._columns[:, 0] << 32 | self._columns[:, 1]
        _, first, block = np.unique(packed, return_index=True, return_inverse=True)
        self._blocks = self._columns[first]
        self._sizes = np.zeros(len(self._blocks), dtype=np.int64)
        np.add.at(self._sizes, block, np.diff(self._bounds))
        self.tiles = [self._tile(members) for members in self._split(tile_points)]

    def members(self, tile: Tile) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The voxels of a tile's core and halo.

        Returns:
            Indices into the voxels, ascending (so Morton order is kept), shape (M,), int64; and
            whether each lies in the core, shape (M,), bool.
        """
        low = np.array(tile.low) - self.halo_blocks
        high = np.array(tile.high) + self.halo_blocks
        chosen = np.flatnonzero(self._within(low, high))
        core = self._within(np.array(tile.low), np.array(tile.high))[chosen]
        sizes = self._bounds[chosen + 1] - self._bounds[chosen]
        ends = np.cumsum(sizes)
        # Each cube's voxels count on from where they stand, not from where the cube before ended.
        shifts = self._bounds[chosen] - (ends - sizes)
        return np.arange(ends[-1]) + np.repeat(shifts, sizes), np.repeat(core, sizes)

    def _within(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which cubes stand in a rectangle of blocks, shape (cubes,)."""
        x, y = self._columns.T
        return (x >= low[0]) & (x < high[0]) & (y >= low[1]) & (y < high[1])

    def _split(self, tile_points: int) -> Iterator[NDArray[np.int64]]:
        """Halve the set of blocks, longer side first, until each part is small enough."""
        sizes = self._sizes
        pending = [np.arange(len(self._blocks))]
        while pending:
            members = pending.pop()
            if not len(members):
                continue
            blocks = self._blocks[members]
            extent = np.ptp(blocks, axis=0)
            if sizes[members].sum() <= tile_points or not extent.any():
                yield members
                continue
            axis = int(extent.argmax())
            order = np.argsort(blocks[:, axis], kind="stable")
            running = np.cumsum(sizes[members[order]])
            middle = blocks[order[np.searchsorted(running, running[-1] / 2)], axis]
            # The cut lies beside the middle row; both sides must keep at least one row.
            cut = min(max(int(middle) + 1, blocks[:, axis].min() + 1), blocks[:, axis].max())
            below = blocks[:, axis] < cut
            pending += [members[~below], members[below]]

    def _tile(self, members: NDArray[np.int64]) -> Tile:
        blocks = self._blocks[members]
        low, high = blocks.min(axis=0), blocks.max(axis=0) + 1
        num_points = int(self._sizes[members].sum())
        return Tile((int(low[0]), int(low[1])), (int(high[0]), int(high[1])), num_points)
