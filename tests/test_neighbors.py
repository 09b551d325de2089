"""Nearest neighbors against brute force."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.neighbors import NeighborIndex, nearest


def cloud(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32)


def plain(points: np.ndarray, queries: np.ndarray, k: int) -> np.ndarray:
    """All distances, sorted; equal ones by index."""
    x, y, z = (queries[:, None] - points).transpose(2, 0, 1)
    return np.argsort(x * x + y * y + z * z, axis=1, kind="stable")[:, :k]


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 1000), count=st.integers(1, 60), k=st.integers(1, 20))
def test_neighbors_are_those_of_brute_force_nearest_first(seed: int, count: int, k: int) -> None:
    points, queries = cloud(seed, count), cloud(seed + 1, 7)
    found = NeighborIndex(points).query(queries, k)
    assert found.dtype == np.int32
    assert found.shape == (7, k)
    expected = plain(points, queries, k)
    np.testing.assert_array_equal(found[:, : expected.shape[1]], expected)


@settings(deadline=None, max_examples=50)
@given(
    seed=st.integers(0, 1000),
    count=st.integers(1, 1500),
    k=st.sampled_from([1, 3, 16, 64]),
    lattice=st.sampled_from([2, 8, 64]),
)
def test_of_equally_near_points_the_first_is_taken(
    seed: int, count: int, k: int, lattice: int
) -> None:
    # Whole numbers: many points at equal distance, many at the same place.
    points = np.random.default_rng(seed).integers(0, lattice, (count, 3)).astype(np.float32)
    k = min(k, count)
    np.testing.assert_array_equal(NeighborIndex(points).query(points, k), plain(points, points, k))


def test_clusters_of_any_density_and_points_far_away() -> None:
    parts = [cloud(seed, 400) * np.float32(10.0**-seed) + seed * 50 for seed in range(4)]
    points = np.concatenate([*parts, [[1e4, 0, 0], [0, -1e6, 3]]]).astype(np.float32)
    order = np.random.default_rng(0).permutation(len(points))
    for each in (points, points[order]):
        found = NeighborIndex(each).query(each, 16)
        np.testing.assert_array_equal(found, plain(each, each, 16))


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


@pytest.mark.parametrize("wild", [np.nan, np.inf, -np.inf, 1e30])
def test_coordinates_beyond_all_bounds_never_lead_out_of_the_points(wild: float) -> None:
    points = cloud(2, 300)
    points[7, 1] = points[200] = wild
    found = NeighborIndex(points).query(points, 5)
    assert found.min() >= 0
    assert found.max() < 300
    if np.isnan(wild):
        return
    sound = np.delete(np.arange(300), [7, 200])
    np.testing.assert_array_equal(sound[plain(points[sound], points[sound], 5)], found[sound])


def test_no_queries_have_no_neighbors() -> None:
    assert NeighborIndex(cloud(0, 9)).query(np.empty((0, 3), np.float32), 4).shape == (0, 4)


@settings(deadline=None)
@given(seed=st.integers(0, 1000), count=st.integers(1, 200), data=st.data())
def test_the_nearest_of_one_place_are_those_of_brute_force(
    seed: int, count: int, data: st.DataObject
) -> None:
    points = cloud(seed, count).round(data.draw(st.integers(0, 3)))
    k = data.draw(st.integers(1, count))
    indices, distances = nearest(points, points[count // 2], k)
    np.testing.assert_array_equal(indices, np.sort(plain(points, points[None, count // 2], k)[0]))
    expected = np.linalg.norm(points[indices] - points[count // 2], axis=1)
    np.testing.assert_allclose(distances, expected, rtol=1e-6)
    assert (indices.dtype, distances.dtype) == (np.int32, np.float32)
