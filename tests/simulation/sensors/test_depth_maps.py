import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.simulation.sensors.depth_maps import matched, nearest


def flat(depth=10.0, side=15):
    return np.full((side, side), depth, np.float32)


def test_level_ground_is_found_as_it_is():
    found, could, source = matched(flat(), 5, 0.1)
    np.testing.assert_array_equal(found, flat())
    assert could.all()
    np.testing.assert_array_equal(source.ravel(), np.arange(15 * 15))


def test_thin_things_vanish():
    depths = flat()
    depths[7] = 5.0  # a wire
    found, _, source = matched(depths, 5, 0.1)
    np.testing.assert_allclose(found, 10.0)
    assert (source // 15 != 7).all()  # what was seen there is the ground beside it


def test_narrow_gaps_close_and_wide_ones_stay():
    narrow, wide = flat(5.0), flat(5.0, side=41)
    narrow[6:9, 6:9] = 10.0
    wide[8:33, 8:33] = 10.0
    np.testing.assert_allclose(matched(narrow, 5, 0.1)[0], 5.0)
    assert matched(wide, 5, 0.1)[0][20, 20] == pytest.approx(10.0)


def test_edges_melt_where_the_step_is_small():
    low, high = flat(), flat()
    low[:, 8:], high[:, 8:] = 9.8, 2.0
    step = matched(low, 5, 0.1)[0][7]
    assert ((step > 9.82) & (step < 9.98)).sum() >= 2
    cliff = matched(high, 5, 0.1)[0][7]
    assert not ((cliff > 2.5) & (cliff < 9.5)).any()


def test_what_is_not_seen_and_what_is_too_steep_cannot_be_matched():
    depths = flat(side=21)
    depths[:, 14:] = 2.0
    depths[:3, :3] = np.inf
    found, could, _ = matched(depths, 5, 0.1)
    assert np.isfinite(found).all()
    assert not could[:4, :4].any()
    assert not could[10, 13:15].any()
    assert could[10, :11].all()


@given(st.integers(0, 2**32), st.sampled_from([3, 5, 7]))
def test_the_nearest_is_what_a_plain_search_finds(seed, window):
    rng = np.random.default_rng(seed)
    depths = rng.uniform(1, 3, (9, 8)).astype(np.float32)
    found = rng.uniform(1, 3, (9, 8)).astype(np.float32)
    source = nearest(depths, found, window)
    half = window // 2
    for row, column in np.ndindex(found.shape):
        rows = slice(max(row - half, 0), row + half + 1)
        columns = slice(max(column - half, 0), column + half + 1)
        least = np.abs(depths[rows, columns] - found[row, column]).min()
        at = divmod(int(source[row, column]), 8)
        assert abs(at[0] - row) <= half
        assert abs(at[1] - column) <= half
        assert np.abs(depths[at] - found[row, column]) == least
