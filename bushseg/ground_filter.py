"""A raster of lowest points becomes one of the ground.

Pits that nothing around confirms (stray returns below ground) are taken out; a grey-scale opening
then removes what is narrower than its window and stands higher (plants, cars, small buildings),
after Zhang et al., "A progressive morphological filter", 2003, in one step.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

WINDOW = 21.0
"""Edge of the opening's window, metres."""

PIT_DEPTH = 2.0
"""A cell this much below everything around it, in metres, is no ground."""


def filter_ground(lowest: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """Ground level of each cell.

    Args:
        lowest: The lowest point in each cell, metres, infinite where there is none; at least one
            isn't. Shape (X, Y), float64.
        cell: Edge of a cell, metres.

    Returns:
        Metres, shape (X, Y), float64.
    """
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
