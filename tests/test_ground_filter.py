"""The ground of a raster, exactly on a few cells, and its parts against plain ones."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bushseg.ground_filter import PIT_DEPTH, WINDOW, _lowest_around, filter_ground


def test_a_plain_stays_and_what_stands_on_it_and_pits_go() -> None:
    raster = np.full((60, 50), 3.0)
    plain = raster.copy()
    raster[10:20, 5:15] = 7.0
    raster[40, 30] = 3.0 - 2 * PIT_DEPTH
    raster[50, :] = np.inf
    np.testing.assert_allclose(filter_ground(raster, 1.0), plain, rtol=1e-12)


def test_what_is_wider_than_the_window_is_ground() -> None:
    raster = np.zeros((80, 80))
    edge = int(WINDOW) + 11
    raster[20 : 20 + edge, 20 : 20 + edge] = 7.0
    assert filter_ground(raster, 1.0)[20 + edge // 2, 20 + edge // 2] > 6.99


@settings(deadline=None)
@given(
    lowest=arrays(
        np.float64,
        st.tuples(st.integers(1, 30), st.integers(1, 30)),
        elements=st.integers(-9, 9).map(float),
    ),
    window=st.sampled_from([5, 7, 21]),
)
def test_the_ring_of_bars_equals_a_plain_erosion(lowest: np.ndarray, window: int) -> None:
    ring = np.ones((window, window), dtype=bool)
    middle = window // 2
    ring[middle - 1 : middle + 2, middle - 1 : middle + 2] = False
    # SciPy's own erosion reads beyond a raster that is much smaller than the window.
    padded = np.pad(lowest, middle, mode="symmetric")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (window, window))
    plain = np.where(ring, windows, np.inf).min(axis=(2, 3))
    np.testing.assert_array_equal(_lowest_around(lowest, window), plain)
