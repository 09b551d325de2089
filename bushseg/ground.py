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

CELL = 1.0
"""Edge of a raster cell, metres; doubled until the raster is small enough."""

WINDOW = 21.0
"""Edge of the opening's window, metres."""

PIT_DEPTH = 2.0
"""A cell this much below everything around it, in metres, is no ground."""

PATCH = 64.0
"""Edge of the blocks, metres, by which far-apart parts of a scan are told apart; over a window."""

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
    for members in _patches(xyz[:, :2]):
        heights[members] = _heights(xyz[members])
    return heights


def _patches(xy: NDArray[np.float64]) -> Iterator[slice | NDArray[np.intp]]:
    """Split a scan that leaves most of its rectangle empty into its connected parts.

    A stray return kilometres away would otherwise stretch the raster over nothing.
    """
    if not len(xy):
        return
    if _num_cells(xy, CELL) <= _CELLS_PER_POINT * len(xy):
        yield slice(None)
        return
    patch = PATCH
    while _num_cells(xy, patch) > _MAX_CELLS:
        patch *= 2
    blocks = np.floor(xy / patch).astype(np.int64)
    blocks -= blocks.min(axis=0)
    occupied = np.zeros(blocks.max(axis=0) + 1, dtype=bool)
    occupied[tuple(blocks.T)] = True
    parts, _ = ndimage.label(occupied, structure=np.ones((3, 3)))
    part = parts[tuple(blocks.T)]
    order = np.argsort(part, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(part[order])) + 1)


def _num_cells(xy: NDArray[np.float64], cell: float) -> float:
    """Cells of a raster over the points, at most."""
    return float(np.prod(np.floor(np.ptp(xy, axis=0) / cell) + 2))


def _heights(xyz: NDArray[np.float64]) -> NDArray[np.float32]:
    """Heights of one connected part, as :func:`height_above_ground`."""
    limit = min(_MAX_CELLS, max(_MIN_CELLS, _CELLS_PER_POINT * len(xyz)))
    cell = CELL
    while _num_cells(xyz[:, :2], cell) > limit:
        cell *= 2
    positions = xyz[:, :2] / cell
    corner = np.floor(positions.min(axis=0))
    positions -= corner
    raster = _ground_raster(positions, xyz[:, 2], cell)
    # A cell's value stands at its middle; linear interpolation leaves no steps between cells.
    ground = ndimage.map_coordinates(raster, (positions - 0.5).T, order=1, mode="nearest")
    height: NDArray[np.float32] = (xyz[:, 2] - ground).astype(np.float32)
    return height


def _ground_raster(
    positions: NDArray[np.float64], z: NDArray[np.float64], cell: float
) -> NDArray[np.float64]:
    """Ground level of each cell, shape (X, Y); positions are in cells and not negative."""
    columns = positions.astype(np.int64)
    shape = tuple(columns.max(axis=0) + 1)
    lowest = np.full(shape, np.inf)
    flat = np.ravel_multi_index((columns[:, 0], columns[:, 1]), shape)
    np.minimum.at(lowest.reshape(-1), flat, z)
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
