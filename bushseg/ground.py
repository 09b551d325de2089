"""Height above the local ground, from voxels alone.

A bush and a tree's crown look alike up close; how high they hang above the ground tells them apart.
The ground is a raster of the lowest point in each cell. Pits that nothing around confirms (stray
returns below ground) are taken out; a grey-scale opening then removes what is narrower than its
window and stands higher (plants, cars, small buildings), after Zhang et al., "A progressive
morphological filter", 2003, in one step. It is a feature for the network, not a terrain model:
under a roof wider than the window it follows the roof.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from bushseg.compiled import compiled
from bushseg.parallel import for_chunks

CELL = 1.0
"""Edge of a raster cell, metres; doubled until the raster is small enough."""

WINDOW = 21.0
"""Edge of the opening's window, metres."""

PIT_DEPTH = 2.0
"""A cell this much below everything around it, in metres, is no ground."""

PATCH = 64.0
"""Edge of the blocks, metres, by which far-apart parts of a scan are told apart; over a window."""

_CHUNK = 65_536  # points a thread takes at a time
_MAX_CELLS = 16_000_000
_MIN_CELLS = 65_536
_CELLS_PER_POINT = 8  # a raster much finer than its points only repeats them


def height_above_ground(xyz: NDArray[np.float64]) -> NDArray[np.float32]:
    """Height of each point above the ground below it.

    Args:
        xyz: Positions in metres, shape (N, 3), float64, relative to an origin that moves with the
            scan (the voxel grid's), so that a moved scan gives the same heights.

    Returns:
        Metres, shape (N,), float32.
    """
    heights = np.empty(len(xyz), dtype=np.float32)
    if len(xyz):
        for members in _patches(xyz):
            heights[members] = _heights(xyz[members])
    return heights


def _patches(xyz: NDArray[np.float64]) -> Iterator[slice | NDArray[np.intp]]:
    """Split a scan that leaves most of its rectangle empty into its connected parts.

    A stray return kilometres away would otherwise stretch the raster over nothing.
    """
    low, high = _extent(xyz)
    if _num_cells(low, high, CELL) <= _CELLS_PER_POINT * len(xyz):
        yield slice(None)
        return
    patch = PATCH
    while _num_cells(low, high, patch) > _MAX_CELLS:
        patch *= 2
    blocks = np.floor(xyz[:, :2] / patch).astype(np.int64)
    blocks -= blocks.min(axis=0)
    occupied = np.zeros(blocks.max(axis=0) + 1, dtype=bool)
    occupied[tuple(blocks.T)] = True
    parts, _ = ndimage.label(occupied, structure=np.ones((3, 3)))
    part = parts[tuple(blocks.T)]
    order = np.argsort(part, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(part[order])) + 1)


def _num_cells(low: NDArray[np.float64], high: NDArray[np.float64], cell: float) -> float:
    """Cells of a raster between two corners, at most."""
    return float(np.prod(np.floor((high - low) / cell) + 2))


def _heights(xyz: NDArray[np.float64]) -> NDArray[np.float32]:
    """Heights of one connected part, as :func:`height_above_ground`."""
    low, high = _extent(xyz)
    limit = min(_MAX_CELLS, max(_MIN_CELLS, _CELLS_PER_POINT * len(xyz)))
    cell = CELL
    while _num_cells(low, high, cell) > limit:
        cell *= 2
    corner = np.floor(low / cell)
    lowest = np.full((high / cell - corner).astype(np.int64) + 1, np.inf)
    _lower(xyz, corner, cell, lowest)
    raster = _ground_raster(lowest, cell)
    heights = np.empty(len(xyz), dtype=np.float32)
    for_chunks(
        lambda start, stop: _rise(xyz, corner, cell, raster, heights, start, stop),
        len(xyz),
        _CHUNK,
    )
    return heights


@compiled
def _extent(xyz: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The corners of the points' rectangle in x and y, shape (2,) each; there is a point."""
    low, high = xyz[0, :2].copy(), xyz[0, :2].copy()
    for i in range(len(xyz)):
        for axis in range(2):
            low[axis] = min(low[axis], xyz[i, axis])
            high[axis] = max(high[axis], xyz[i, axis])
    return low, high


@compiled
def _lower(
    xyz: NDArray[np.float64], corner: NDArray[np.float64], cell: float, lowest: NDArray[np.float64]
) -> None:
    """Lower each cell of a raster, which begins at `corner` (in cells), to its lowest point."""
    for i in range(len(xyz)):
        x, y = int(xyz[i, 0] / cell - corner[0]), int(xyz[i, 1] / cell - corner[1])
        lowest[x, y] = min(lowest[x, y], xyz[i, 2])


@compiled
def _rise(
    xyz: NDArray[np.float64],
    corner: NDArray[np.float64],
    cell: float,
    raster: NDArray[np.float64],
    heights: NDArray[np.float32],
    start: int,
    stop: int,
) -> None:
    """Heights of points start to stop above the raster.

    A cell's value stands at its middle; linear interpolation leaves no steps between cells.
    """
    rows, columns = raster.shape
    for i in range(start, stop):
        x = min(max(xyz[i, 0] / cell - corner[0] - 0.5, 0.0), rows - 1.0)
        y = min(max(xyz[i, 1] / cell - corner[1] - 0.5, 0.0), columns - 1.0)
        row, column = int(x), int(y)
        below, right = min(row + 1, rows - 1), min(column + 1, columns - 1)
        x, y = x - row, y - column
        near = raster[row, column] * (1 - y) + raster[row, right] * y
        far = raster[below, column] * (1 - y) + raster[below, right] * y
        heights[i] = xyz[i, 2] - (near * (1 - x) + far * x)


def _ground_raster(lowest: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """Ground level of each cell from its lowest point, infinite where it has none; (X, Y)."""
    empty = np.isinf(lowest)
    if empty.any():
        nearest = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
        lowest = lowest[tuple(nearest)]
    window = max(5, 2 * round(WINDOW / cell / 2) + 1)
    # In a dense stand few cells see the ground, so a pit counts only if it is alone in the window.
    around = _lowest_around(lowest, window)
    cleaned = np.where(lowest < around - PIT_DEPTH, around, lowest)
    opened = ndimage.grey_opening(cleaned, size=(window, window))
    raster: NDArray[np.float64] = ndimage.gaussian_filter(opened, sigma=1.0, mode="nearest")
    return raster


def _lowest_around(lowest: NDArray[np.float64], window: int) -> NDArray[np.float64]:
    """The minimum of each cell's window without its middle 3 x 3 cells, shape (X, Y).

    Equals a grey-scale erosion by that ring; as four bars, each of them separable, it costs a ninth
    of it.
    """
    middle = window // 2
    rows, columns = lowest.shape
    padded = np.pad(lowest, middle, mode="symmetric")
    # Padded cell i begins the window of cell i; i + middle + 2 begins what lies past the 3 x 3.
    across = _lowest_ahead(padded, window, axis=1)[:, :columns]
    low_high = _lowest_ahead(across, middle - 1, axis=0)
    beside = _lowest_ahead(padded, 3, axis=0)[middle - 1 : middle - 1 + rows]
    left_right = _lowest_ahead(beside, middle - 1, axis=1)
    past = middle + 2
    bars = (
        low_high[:rows],
        low_high[past : past + rows],
        left_right[:, :columns],
        left_right[:, past : past + columns],
    )
    around: NDArray[np.float64] = np.minimum.reduce(bars)
    return around


def _lowest_ahead(values: NDArray[np.float64], size: int, axis: int) -> NDArray[np.float64]:
    """The minimum of the `size` values that begin at each one, along an axis."""
    lowest: NDArray[np.float64] = ndimage.minimum_filter1d(
        values, size, axis=axis, origin=-(size // 2)
    )
    return lowest
