import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.simulation.places.lines import (
    beside,
    length,
    loop,
    nearest,
    spaced,
    stretch,
    winding,
)

CORNER = np.array([(0, 0), (4, 0), (4, 3)], float)


def test_nearest_on_a_corner():
    side, on, along = nearest(CORNER, np.array([(2, 1), (2, -1), (5, 2), (6, 5)], float))
    np.testing.assert_allclose(side, (1, -1, -1, -np.sqrt(8)))
    np.testing.assert_allclose(on, [(2, 0), (2, 0), (4, 2), (4, 3)])
    np.testing.assert_allclose(along, (2, 2, 6, 7))


def test_points_at_a_spacing():
    points, yaws = spaced(CORNER, 2.0, start=1.0)
    np.testing.assert_allclose(points, [(1, 0), (3, 0), (4, 1)])
    np.testing.assert_allclose(yaws, (0, 0, np.pi / 2))


def test_a_stretch_is_its_share_of_the_line():
    part = stretch(np.array([(0, 0), (80, 0)], float), 0.25, 0.75)
    assert part[0] == pytest.approx((20, 0))
    assert 58 <= part[-1][0] <= 60
    assert length(CORNER) == 7


def test_beside_is_to_the_left():
    np.testing.assert_allclose(beside(np.array([(0, 0), (1, 0)], float), 2), [(0, 2), (1, 2)])


@given(seed=st.integers(0, 10_000), size=st.floats(20, 200), bend=st.floats(0, 0.4))
def test_windings_stay_on_the_site(seed, size, bend):
    line = winding(np.random.default_rng(seed), size, bend)
    assert ((line > 0) & (line < size)).all()
    assert length(line) >= size - 2.001
    around = loop(np.random.default_rng(seed), size)
    assert ((around > 0) & (around < size)).all()


@pytest.mark.parametrize("seed", range(5))
def test_nearest_is_what_all_segments_say(seed):
    rng = np.random.default_rng(seed)
    line = winding(rng, 40, 0.2)
    xy = rng.uniform(0, 40, (50, 2))
    side, on, _ = nearest(line, xy)
    dense = spaced(line, 0.01)[0]
    plain = np.linalg.norm(xy[:, None] - dense, axis=2).min(axis=1)
    np.testing.assert_allclose(np.abs(side), plain, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(xy - on, axis=1), np.abs(side), atol=1e-9)
