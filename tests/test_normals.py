"""Normals: known surfaces, degenerate neighborhoods, and the closed form against LAPACK."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.neighbors import NeighborIndex
from bushseg.normals import UP, covariance, estimate_normals, smallest_eigenvector


def normals_of(xyz: np.ndarray, k: int = 10, sensor: np.ndarray | None = None) -> np.ndarray:
    points = np.asarray(xyz, dtype=np.float32)
    return estimate_normals(points, NeighborIndex(points).query(points, k), sensor)


ENTRIES = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]  # xx yy zz xy xz yz


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.6, 0, 0.8), (-0.48, 0.64, 0.6), (1, 0, 1e-3)])
def test_points_of_a_plane_have_its_normal_upwards(normal: tuple[float, float, float]) -> None:
    unit = np.array(normal) / np.linalg.norm(normal)
    xyz = np.random.default_rng(0).normal(size=(300, 3))
    xyz -= (xyz @ unit)[:, None] * unit
    np.testing.assert_allclose(normals_of(xyz), np.tile(unit, (300, 1)), atol=1e-4)


def test_normals_point_to_the_sensor() -> None:
    rng = np.random.default_rng(1)
    wall = np.column_stack([rng.random(200), np.zeros(200), rng.random(200)])
    for side in (-1.0, 1.0):
        normals = normals_of(wall, sensor=np.array([0.5, 30.0 * side, 0.5]))
        np.testing.assert_allclose(normals, np.tile([0, side, 0], (200, 1)), atol=1e-4)
    below = normals_of(wall[:, [0, 2, 1]], sensor=np.array([0, 0, -5.0]))
    np.testing.assert_allclose(below, np.tile([0, 0, -1], (200, 1)), atol=1e-4)


def test_orienting_flips_only_what_points_away() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(500, 3)).astype(np.float32)
    neighbors = NeighborIndex(points).query(points, 8)
    up = estimate_normals(points, neighbors)
    assert (up[:, 2] >= 0).all()
    sensor = np.array([3.0, -2, 1])
    oriented = estimate_normals(points, neighbors, sensor)
    towards = np.einsum("ij,ij->i", up, sensor - points)
    np.testing.assert_array_equal(oriented, np.where((towards < 0)[:, None], -up, up))
    assert (np.einsum("ij,ij->i", oriented, sensor - points) >= 0).all()


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 0, 1), (1, 2, 3), (-0.3, 5, 0.01)])
def test_a_line_gets_a_unit_normal_across_it(direction: tuple[float, float, float]) -> None:
    along = np.array(direction) / np.linalg.norm(direction)
    normals = normals_of(np.linspace(-4, 4, 40)[:, None] * along)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(normals @ along, 0, atol=1e-3)
    assert (normals[:, 2] >= 0).all()


@pytest.mark.parametrize("count", [1, 2, 12])
def test_no_extent_means_upwards(count: int) -> None:
    xyz = np.full((count, 3), [5.0, -3.0, 2.0])
    np.testing.assert_array_equal(normals_of(xyz), np.tile(UP, (count, 1)))


def test_a_covariance_is_numpys() -> None:
    for offsets in np.random.default_rng(2).normal(size=(5, 3, 16)):
        expected = np.cov(offsets, bias=True)[ENTRIES]
        np.testing.assert_allclose(covariance(*offsets), expected, atol=1e-12)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(4, 60), flat=st.sampled_from([1, 0.1]))
def test_normals_are_lapacks(seed: int, count: int, flat: float) -> None:
    points = (np.random.default_rng(seed).normal(size=(count, 3)) * [1, 1, flat]).astype(np.float32)
    neighbors = NeighborIndex(points).query(points, 12)
    normals = estimate_normals(points, neighbors)
    for normal, row in zip(normals, neighbors, strict=True):
        values, vectors = np.linalg.eigh(np.cov(points[row].astype(np.float64).T, bias=True))
        if values[1] - values[0] > 1e-3 * values.sum():
            upwards = vectors[:, 0] * np.where(vectors[2, 0] < 0, -1, 1)
            np.testing.assert_allclose(normal, upwards, atol=1e-5)


def test_the_place_of_the_cloud_does_not_matter() -> None:
    xyz = np.random.default_rng(3).normal(size=(200, 3)) * [3, 3, 0.02]
    moved = np.float32(xyz) + np.float32([512, 256, 64])
    assert (np.abs((normals_of(xyz) * normals_of(moved)).sum(axis=1)) > 0.999).all()


@settings(deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    stretch=st.tuples(*[st.floats(-6, 0)] * 3),
    size=st.floats(-8, 8),
)
def test_the_smallest_eigenvector_is_lapacks(
    seed: int, stretch: tuple[float, float, float], size: float
) -> None:
    rng = np.random.default_rng(seed)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    values = 10.0 ** (np.array(stretch) + size)
    matrix = rotation @ np.diag(values) @ rotation.T
    vector = np.array(smallest_eigenvector(*matrix[ENTRIES]))
    assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-9)
    # Where eigenvalues nearly coincide any vector between them serves: compare what it minimizes.
    smallest = np.linalg.eigh(matrix)[0][0]
    assert vector @ matrix @ vector <= smallest + 1e-6 * np.trace(matrix)


def test_many_chunks_equal_one(monkeypatch: pytest.MonkeyPatch) -> None:
    xyz = np.random.default_rng(4).normal(size=(100, 3))
    whole = normals_of(xyz)
    monkeypatch.setattr("bushseg.normals._CHUNK", 7)
    np.testing.assert_array_equal(normals_of(xyz), whole)
