"""What stereo matching makes of depth: it sees windows, not points."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter, grey_opening, median_filter

THIN = 3
"""What is thinner than about half so many pixels is not matched."""

MELT = 0.8
"""Depths that differ by so much are still drawn together by smoothing, metres."""

STEEPEST = 8.0
"""A matched surface falls off by at most so much, metres a metre; cliffs others see better."""

ROUGHEST = 2.0
"""Where true depths are off the matched one by so much on average, windows don't match, metres."""

Depths = NDArray[np.float32]


def matched(
    depths: Depths, window: int, pixel: float
) -> tuple[Depths, NDArray[np.bool_], NDArray[np.intp]]:
    """The depth map that matching windows of pixels finds.

    Thin things vanish, gaps close, edges melt.

    Args:
        depths: Of the first thing in each pixel, metres, inf for nothing, (H, W), float32.
        window: Edge of a window in pixels, odd.
        pixel: Edge of a pixel, metres.

    Returns:
        Depths, metres, (H, W), float32; whether each could be matched, (H, W); and the pixel of the
        window whose true depth is the nearest to the one found, as an index into the map's pixels
        in order, (H, W).
    """
    known = np.isfinite(depths)
    filled = np.where(known, depths, depths[known].max(initial=0.0))
    # Gaps that are narrower than a window are dark and filled by what is in front of them.
    front: Depths = grey_opening(median_filter(filled, THIN), size=(window, window))
    smooth = gaussian_filter(front, window / 2.5)
    even = np.exp(-(((front - smooth) / MELT) ** 2))
    found = (even * smooth + (1 - even) * front).astype(np.float32)
    rough = gaussian_filter(np.abs(filled - found), window / 2)
    steep = np.hypot(*np.gradient(found, pixel)) > STEEPEST
    inner = binary_erosion(known, np.ones((window, window), dtype=bool), border_value=1)
    return found, inner & ~steep & (rough < ROUGHEST), nearest(filled, found, window)


def nearest(depths: Depths, found: Depths, window: int) -> NDArray[np.intp]:
    """Which pixel around each has the depth nearest to what was found there.

    Args:
        depths: True depths, metres, (H, W).
        found: Matched depths, metres, (H, W).
        window: Edge of the window that is searched, pixels, odd.

    Returns:
        Indices into the map's pixels in order, (H, W).
    """
    height, width = depths.shape
    half = window // 2
    padded = np.pad(depths, half, constant_values=np.inf)
    least = np.full(depths.shape, np.inf, np.float32)
    shift = np.zeros(depths.shape, np.intp)
    # From the middle outwards: of equally near ones the pixel itself is taken.
    steps = [(down, right) for down in range(-half, half + 1) for right in range(-half, half + 1)]
    for down, right in sorted(steps, key=lambda step: step[0] ** 2 + step[1] ** 2):
        some = padded[half + down : half + down + height, half + right : half + right + width]
        off = np.abs(some - found)
        better = off < least
        np.copyto(least, off, where=better)
        np.copyto(shift, down * width + right, where=better)
    indices: NDArray[np.intp] = np.arange(height * width).reshape(height, width) + shift
    return indices
