import numpy as np

from bushseg.simulation.site import MARGIN, Layout


def test_the_first_free_place_is_taken():
    layout = Layout(20, discs=[(5, 5, 2)])
    candidates = np.array([(5, 6), (5, 9), (15, 15)], float)
    np.testing.assert_array_equal(layout.claim(candidates, 1.5, keep=0.5), (5, 9))
    assert layout.discs[-1] == (5, 9, 0.5)


def test_where_nothing_is_free_the_widest_gap_is_taken():
    layout = Layout(20, discs=[(5, 5, 2)])
    candidates = np.array([(5, 6), (5, 8), (5, 7)], float)
    np.testing.assert_array_equal(layout.claim(candidates, 3), (5, 8))


def test_places_keep_off_the_edge():
    np.testing.assert_array_equal(
        Layout(20).claim(np.array([(-3, 25)], float), 1), (MARGIN, 20 - MARGIN)
    )
