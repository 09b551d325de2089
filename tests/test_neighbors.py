"""Nearest neighbors against brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.neighbors import NeighborIndex


def cloud(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 1000), count=st.integers(1, 60), k=st.integers(1, 20))
def test_neighbors_are_those_of_brute_force_nearest_first(seed: int, count: int, k: int) -> None:
    points, queries = cloud(seed, count), cloud(seed + 1, 7)
    found = NeighborIndex(points).query(queries, k)
    assert found.dtype == np.int32
    assert found.shape == (7, k)
    distances = np.linalg.norm(queries[:, None] - points, axis=2)
    order = np.argsort(distances, axis=1, kind="stable")[:, :k]
    np.testing.assert_array_equal(found[:, : order.shape[1]], order)


def test_a_point_finds_itself_first() -> None:
    points = cloud(0, 500)
    found = NeighborIndex(points).query(points, 16)
    assert found[:, 0].tolist() == list(range(500))


@pytest.mark.parametrize(("k", "expected"), [(5, [0, 1, 2, 0, 1]), (3, [0, 1, 2]), (2, [0, 1])])
def test_too_few_points_are_repeated_in_turn(k: int, expected: list[int]) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0]], dtype=np.float32)
    assert NeighborIndex(points).query(points[:1], k).tolist() == [expected]


def test_a_lone_point_is_its_own_neighborhood() -> None:
    points = np.zeros((1, 3), dtype=np.float32)
    assert NeighborIndex(points).query(points, 4).tolist() == [[0, 0, 0, 0]]


def test_strided_input_is_taken_as_it_reads() -> None:
    points = cloud(1, 100)[::2]
    assert NeighborIndex(points).query(points[::-1], 1)[:, 0].tolist() == list(range(50))[::-1]
