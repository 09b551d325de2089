"""The levels: indices that fit, nearest survivors, and a fate that doesn't depend on the tile."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.config import Sampling
from bushseg.grid import VoxelGrid, decode_morton
from bushseg.neighbors import NeighborIndex
from bushseg.pyramid import Pyramid, build_pyramid

VOXEL = 0.25


def scene(
    seed: int, edges: tuple[float, float, float], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """One point in each occupied voxel of a box, in Morton order: xyz and keys."""
    xyz = np.random.default_rng(seed).random((count, 3)) * edges
    keys, first = np.unique(VoxelGrid(np.zeros(3), VOXEL).keys(xyz), return_index=True)
    return xyz[first].astype(np.float32), keys


def build(xyz: np.ndarray, keys: np.ndarray, sampling: Sampling = "mrs", seed: int = 0) -> Pyramid:
    return build_pyramid(
        xyz, keys, num_neighbors=8, num_levels=3, decimation=4, sampling=sampling, seed=seed
    )


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 1000),
    count=st.integers(1, 300),
    sampling=st.sampled_from(["mrs", "random"]),
)
def test_every_levels_indices_fit_the_level(seed: int, count: int, sampling: Sampling) -> None:
    xyz, keys = scene(seed, (4, 4, 2), count)
    pyramid = build(xyz, keys, sampling)
    assert pyramid.num_levels == 3
    levels = zip(pyramid.neighbors, pyramid.decimated, pyramid.interpolated, strict=True)
    for neighbors, decimated, interpolated in levels:
        size = len(xyz)
        assert neighbors.dtype == decimated.dtype == interpolated.dtype == np.int32
        assert neighbors.shape == (size, 8)
        assert interpolated.shape == (size,)
        assert 1 <= len(decimated) <= size
        assert (np.diff(decimated) > 0).all()
        assert 0 <= decimated.min() <= decimated.max() < size
        assert neighbors[:, 0].tolist() == list(range(size))
        assert 0 <= neighbors.min() <= neighbors.max() < size
        # The nearest survivor, by brute force.
        distances = np.linalg.norm(xyz[:, None] - xyz[decimated], axis=2)
        np.testing.assert_allclose(
            distances[np.arange(size), interpolated], distances.min(axis=1), rtol=1e-5
        )
        assert interpolated[decimated].tolist() == list(range(len(decimated)))
        xyz = xyz[decimated]


@pytest.mark.parametrize("sampling", ["mrs", "random"])
def test_the_nearest_survivor_is_the_one_a_search_finds(sampling: Sampling) -> None:
    xyz, keys = scene(4, (20, 20, 2), 4_000)
    xyz = xyz.round(1)  # so that several are equally near
    pyramid = build(xyz, keys, sampling)
    for decimated, interpolated in zip(pyramid.decimated, pyramid.interpolated, strict=True):
        found = NeighborIndex(xyz[decimated]).query(xyz, 1)[:, 0]
        np.testing.assert_array_equal(interpolated, found)
        xyz = xyz[decimated]


@pytest.mark.parametrize("sampling", ["mrs", "random"])
def test_each_level_holds_about_a_quarter(sampling: Sampling) -> None:
    xyz, keys = scene(1, (40, 20, 0.5), 12_000)
    pyramid = build(xyz, keys, sampling)
    sizes = [len(xyz), *(len(decimated) for decimated in pyramid.decimated)]
    for above, below in pairwise(sizes):
        assert below / above == pytest.approx(0.25, abs=0.05)


def test_seeds_choose_otherwise_and_equal_seeds_the_same() -> None:
    xyz, keys = scene(2, (10, 10, 0.5), 2_000)
    first, again, other = build(xyz, keys), build(xyz, keys), build(xyz, keys, seed=1)
    np.testing.assert_array_equal(first.decimated[0], again.decimated[0])
    assert set(first.decimated[0]) != set(other.decimated[0])


@pytest.mark.parametrize(
    ("sampling", "at_least"), [("mrs", (0.99, 0.95, 0.9)), ("random", (1, 1, 1))]
)
def test_a_voxels_fate_does_not_depend_on_the_tile_it_is_seen_in(
    sampling: Sampling, at_least: tuple[float, ...]
) -> None:
    xyz, keys = scene(3, (80, 6, 0.5), 16_000)
    block = decode_morton(keys)[:, 0] // 16  # 4 m: what tiles are cut along
    survivors = []
    for part in (block < 14, block >= 6):
        points, part_keys = xyz[part], keys[part]
        levels = []
        for decimated in build(points, part_keys, sampling).decimated:
            points, part_keys = points[decimated], part_keys[decimated]
            middle = (points[:, 0] > 36) & (points[:, 0] < 44)
            levels.append(set(part_keys[middle].tolist()))
        survivors.append(levels)
    for ours, theirs, share in zip(*survivors, at_least, strict=True):
        assert len(ours & theirs) / len(ours | theirs) >= share
