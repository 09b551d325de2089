"""Tiles: every voxel in one core, cores of bounded size, halos that miss nothing."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg import tiling as module
from bushseg.grid import BLOCK, decode_morton, encode_morton
from bushseg.scratch import Scratch
from bushseg.tiling import Tiling


def keys_of(cells: np.ndarray) -> np.ndarray:
    return np.unique(encode_morton(np.asarray(cells, dtype=np.uint64)))


def scattered(seed: int, count: int = 400, extent: int = 200) -> np.ndarray:
    """Voxels at random, with one dense spot."""
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, extent, (count, 3))
    cells[: count // 2] //= 8
    return keys_of(cells)


@settings(deadline=None)
@given(seed=st.integers(0, 1000), tile_points=st.integers(1, 500), halo=st.integers(0, 40))
def test_cores_partition_the_voxels_and_halos_hold_all_within_reach(
    seed: int, tile_points: int, halo: int
) -> None:
    keys = scattered(seed)
    columns = decode_morton(keys)[:, :2]
    blocks = columns // BLOCK
    _, block_sizes = np.unique(blocks, axis=0, return_counts=True)
    tiling = Tiling(keys, tile_points, halo)
    visits = np.zeros(len(keys), dtype=int)
    for tile in tiling.tiles:
        indices, is_core = tiling.members(tile)
        assert (np.diff(indices) > 0).all()
        core = indices[is_core]
        visits[core] += 1
        assert len(core) == tile.num_points
        assert len(indices) == tiling.size(tile)
        assert len(core) <= max(tile_points, block_sizes.max())
        low = (columns[core] - halo).min(axis=0)
        high = (columns[core] + halo).max(axis=0)
        within = ((columns >= low) & (columns <= high)).all(axis=1)
        assert np.isin(np.flatnonzero(within), indices).all()
        # No more context than was asked for, rounded up to whole blocks.
        reach = (-(-halo // BLOCK) + 1) * BLOCK
        assert (columns[indices] > columns[core].min(axis=0) - reach).all()
        assert (columns[indices] < columns[core].max(axis=0) + reach).all()
    assert (visits == 1).all()


def test_cut_again_it_is_cut_as_anew() -> None:
    keys = scattered(3)
    tiling = Tiling(keys, 50, 16)
    before = list(tiling.tiles)
    again, anew = tiling.recut(120, 40), Tiling(keys, 120, 40)
    assert again.tiles == anew.tiles != before
    for tile in anew.tiles:
        for ours, theirs in zip(again.members(tile), anew.members(tile), strict=True):
            np.testing.assert_array_equal(ours, theirs)
    assert (tiling.tiles, tiling.halo_blocks) == (before, 1)


def test_pages_are_let_go_while_voxels_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of ten blocks of keys no two are held at once, in neither pass."""
    scratch = Scratch(tmp_path)
    keys = scratch.empty("keys", (1000,), np.int64)
    keys[:] = np.sort(np.random.default_rng(0).choice(10**9, 1000, replace=False))
    monkeypatch.setattr("bushseg.scratch.BLOCK_ROWS", 100)
    released: list[int] = []
    monkeypatch.setattr(scratch, "release", lambda: released.append(0))
    Tiling(keys, 50, 16, scratch)
    assert len(released) >= 20


def test_tiles_of_an_even_field_are_of_about_equal_size() -> None:
    x, y = np.meshgrid(np.arange(512), np.arange(512))
    keys = keys_of(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]))
    sizes = [tile.num_points for tile in Tiling(keys, 40_000, 0).tiles]
    assert sum(sizes) == len(keys)
    assert max(sizes) <= 40_000
    assert min(sizes) >= 20_000


@pytest.mark.parametrize("most", [1, 7, 40])
def test_where_there_are_too_many_blocks_four_count_as_one(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = scattered(5)
    columns = decode_morton(keys)[:, :2] // BLOCK
    monkeypatch.setattr(module, "_MOST_BLOCKS", most)
    shift = next(n for n in range(22) if len(np.unique(columns >> n, axis=0)) <= most)
    tiling = Tiling(keys, 20, 16)
    found = np.concatenate([tiling.core(tile) for tile in tiling.tiles])
    np.testing.assert_array_equal(np.sort(found), np.arange(len(keys)))
    assert sum(tile.num_points for tile in tiling.tiles) == len(keys)
    for tile in tiling.tiles:
        assert all(edge % (1 << shift) == 0 for edge in (*tile.low, *tile.high))


def test_a_dense_block_stays_whole() -> None:
    z = np.arange(5_000)
    keys = keys_of(np.column_stack([z % BLOCK, z % 7, z]))
    tiling = Tiling(keys, 1_000, 64)
    assert [tile.num_points for tile in tiling.tiles] == [len(keys)]


def test_an_outlier_far_away_costs_no_more_than_a_tile() -> None:
    near = scattered(0)
    keys = np.append(near, keys_of(np.array([[2_000_000, 2_000_000, 2_000_000]])))
    tiling = Tiling(keys, len(near), 64)
    assert len(tiling.tiles) == 2
    assert sum(tile.num_points for tile in tiling.tiles) == len(keys)
    (far,) = (tile for tile in tiling.tiles if tile.high[0] > 100_000)
    indices, is_core = tiling.members(far)
    assert is_core[indices == len(near)].all()


@pytest.mark.parametrize("halo", [0, 1, 512])
def test_one_voxel_is_one_tile(halo: int) -> None:
    tiling = Tiling(keys_of(np.array([[7, 300, 5]])), 1, halo)
    (tile,) = tiling.tiles
    indices, is_core = tiling.members(tile)
    assert (indices.tolist(), is_core.tolist()) == ([0], [True])


@pytest.mark.parametrize(("halo", "blocks"), [(0, 0), (1, 1), (16, 1), (17, 2)])
def test_the_halo_is_rounded_up_to_blocks(halo: int, blocks: int) -> None:
    assert Tiling(scattered(1), 100, halo).halo_blocks == blocks
