"""Height above the local ground, from voxels alone.

A bush and a tree's crown look alike up close; how high they hang above the ground tells them apart.
The ground is a raster of the lowest point in each cell, rid of what is no ground by
:mod:`bushseg.ground_filter`. It is a feature for the network, not a terrain model: under a roof
wider than the filter's window it follows the roof.

The raster is kept in sheets, and only where there are points: a stray return kilometres away costs
one sheet. Each is filtered with a margin of what lies around it, so that sheets fit together.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.ground_filter import filter_ground
from bushseg.parallel import for_chunks
from bushseg.scratch import Scratch

CELL = 1.0
"""Edge of a raster cell, metres; doubled until the raster is small enough."""

SHEET = 256
"""Edge of a sheet, cells."""

MARGIN = 64
"""Cells around a sheet that its ground depends on: the windows of the filters, one after the other,
reach 34, the rest is for cells without a point, which take the nearest one's."""

_CHUNK = 65_536  # points a thread takes at a time
_MAX_SHEETS = 1 << 22  # places for sheets, most of them empty
_MIN_CELLS = 1 << 20
_CELLS_PER_POINT = 8  # a raster much finer than its points only repeats them


def height_above_ground(xyz: NDArray[np.float64]) -> NDArray[np.float32]:
    """Height of each point above the ground below it.

    Args:
        xyz: Positions in metres, shape (N, 3), float64, relative to an origin that moves with the
            scan (the voxel grid's), so that a moved scan gives the same heights.

    Returns:
        Metres, shape (N,), float32.
    """
    if not len(xyz):
        return np.empty(0, dtype=np.float32)
    return Ground.below(xyz, Scratch()).heights(xyz)


@dataclass(frozen=True, slots=True)
class Ground:
    """The ground below a scan.

    Attributes:
        cell: Edge of a cell, metres.
        corner: The first cell in x and y, counted from the origin, shape (2,), float64.
        rows: Which raster a sheet has, -1 for none, shape (X, Y), int32.
        rasters: Ground level of each sheet's cells, with one cell more on each side, metres, shape
            (sheets, H + 2, W + 2), float64.
    """

    cell: float
    corner: NDArray[np.float64]
    rows: NDArray[np.int32]
    rasters: NDArray[np.float64]

    @classmethod
    def below(cls, xyz: NDArray[np.float64], scratch: Scratch) -> Self:
        """The ground below some points.

        Args:
            xyz: Positions as in :func:`height_above_ground`, N >= 1.
            scratch: Makes the rasters.

        Raises:
            WriteError: It can't.
        """
        cell, corner, shape, rows = _layout(xyz, scratch)
        sheet = tuple(min(SHEET, int(size)) for size in shape)
        lowest = scratch.empty("lowest", (int(rows.max()) + 1, *sheet), np.float64)
        lowest.fill(np.inf)
        for block in scratch.blocks(len(xyz)):
            _lower(xyz[block], corner, cell, rows, lowest)
        rasters = scratch.empty("ground", (len(lowest), sheet[0] + 2, sheet[1] + 2), np.float64)
        for place in np.argwhere(rows >= 0):
            rasters[rows[tuple(place)]] = _sheet_ground(lowest, rows, place, shape, cell)
            scratch.release()
        return cls(cell, corner, rows, rasters)

    def heights(self, xyz: NDArray[np.float64]) -> NDArray[np.float32]:
        """Height above it of some of its points, metres, shape (N,), float32."""
        heights = np.empty(len(xyz), dtype=np.float32)
        for_chunks(
            lambda start, stop: _rise(
                xyz, self.corner, self.cell, self.rows, self.rasters, heights, start, stop
            ),
            len(xyz),
            _CHUNK,
        )
        return heights


def _layout(
    xyz: NDArray[np.float64], scratch: Scratch
) -> tuple[float, NDArray[np.float64], NDArray[np.int64], NDArray[np.int32]]:
    """The cell's size, the first cell, the raster's shape in cells, and the sheets' rows."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for block in scratch.blocks(len(xyz)):
        _widen(xyz[block], low, high)
    limit = max(_MIN_CELLS, _CELLS_PER_POINT * len(xyz))
    cell = CELL
    while True:
        corner = np.floor(low / cell)
        shape = np.floor(high / cell) - corner + 1
        sheets = np.ceil(shape / SHEET)
        if sheets.prod() <= _MAX_SHEETS:
            rows = np.full(sheets.astype(np.int64), -1, dtype=np.int32)
            for block in scratch.blocks(len(xyz)):
                _mark(xyz[block], corner, cell, rows)
            used = rows >= 0
            if np.count_nonzero(used) * np.minimum(shape, SHEET).prod() <= limit:
                rows[used] = np.arange(np.count_nonzero(used))
                return cell, corner, shape.astype(np.int64), rows
        cell *= 2


def _sheet_ground(
    lowest: NDArray[np.float64],
    rows: NDArray[np.int32],
    place: NDArray[np.intp],
    shape: NDArray[np.int64],
    cell: float,
) -> NDArray[np.float64]:
    """Ground level of the sheet at a place, with one cell more on each side."""
    first = place * SHEET
    last = np.minimum(first + SHEET, shape)
    low, high = np.maximum(first - MARGIN, 0), np.minimum(last + MARGIN, shape)
    window = np.full(high - low, np.inf)
    for x in range(low[0] // SHEET, (high[0] - 1) // SHEET + 1):
        for y in range(low[1] // SHEET, (high[1] - 1) // SHEET + 1):
            if rows[x, y] >= 0:
                corner = np.array([x, y]) * SHEET
                start = np.maximum(low, corner)
                stop = np.minimum(high, corner + SHEET)
                here, there = _box(start - low, stop - low), _box(start - corner, stop - corner)
                window[here] = lowest[rows[x, y]][there]
    raster = filter_ground(window, cell)
    # Beyond the scan's border the outermost cells go on.
    start, stop = np.maximum(first - 1, low), np.minimum(last + 1, high)
    before = start - (first - 1)
    after = np.array(lowest.shape[1:]) + 2 - (stop - start) - before
    inner = raster[_box(start - low, stop - low)]
    padded: NDArray[np.float64] = np.pad(inner, np.column_stack([before, after]), mode="edge")
    return padded


def _box(start: NDArray[np.int64], stop: NDArray[np.int64]) -> tuple[slice, slice]:
    """A rectangle of cells."""
    return slice(start[0], stop[0]), slice(start[1], stop[1])


@compiled
def _widen(xyz: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
    """Widen a rectangle's corners in x and y, shape (2,) each, so that it holds some points."""
    for i in range(len(xyz)):
        for axis in range(2):
            low[axis] = min(low[axis], xyz[i, axis])
            high[axis] = max(high[axis], xyz[i, axis])


@compiled
def _mark(
    xyz: NDArray[np.float64], corner: NDArray[np.float64], cell: float, rows: NDArray[np.int32]
) -> None:
    """Mark the sheets that hold points, by a 0."""
    for i in range(len(xyz)):
        x = int(np.floor(xyz[i, 0] / cell) - corner[0])
        y = int(np.floor(xyz[i, 1] / cell) - corner[1])
        rows[x // SHEET, y // SHEET] = 0


@compiled
def _lower(
    xyz: NDArray[np.float64],
    corner: NDArray[np.float64],
    cell: float,
    rows: NDArray[np.int32],
    lowest: NDArray[np.float64],
) -> None:
    """Lower each cell of the sheets' rasters to its lowest point."""
    for i in range(len(xyz)):
        x = int(np.floor(xyz[i, 0] / cell) - corner[0])
        y = int(np.floor(xyz[i, 1] / cell) - corner[1])
        row = rows[x // SHEET, y // SHEET]
        lowest[row, x % SHEET, y % SHEET] = min(lowest[row, x % SHEET, y % SHEET], xyz[i, 2])


@compiled
def _rise(
    xyz: NDArray[np.float64],
    corner: NDArray[np.float64],
    cell: float,
    rows: NDArray[np.int32],
    rasters: NDArray[np.float64],
    heights: NDArray[np.float32],
    start: int,
    stop: int,
) -> None:
    """Heights of points start to stop.

    A cell's value stands at its middle; linear interpolation leaves no steps between cells.
    """
    for i in range(start, stop):
        x, y = xyz[i, 0] / cell - corner[0], xyz[i, 1] / cell - corner[1]
        sheet_x, sheet_y = int(np.floor(x)) // SHEET, int(np.floor(y)) // SHEET
        raster = rasters[rows[sheet_x, sheet_y]]
        # A sheet's first cell is the one before it, whose middle lies half a cell before it.
        x, y = x - sheet_x * SHEET + 0.5, y - sheet_y * SHEET + 0.5
        row, column = int(x), int(y)
        x, y = x - row, y - column
        near = raster[row, column] * (1 - y) + raster[row, column + 1] * y
        far = raster[row + 1, column] * (1 - y) + raster[row + 1, column + 1] * y
        heights[i] = xyz[i, 2] - (near * (1 - x) + far * x)
