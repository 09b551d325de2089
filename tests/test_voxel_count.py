"""Counting voxels in little memory, against counting them all."""

import numpy as np
import pytest

from bushseg import voxel_count
from bushseg.grid import VoxelGrid
from bushseg.voxel_count import VoxelCounter

GRID = VoxelGrid.around([0.0, 0, 0], 0.5)


def count(xyz: np.ndarray, chunk: int) -> int:
    counter = VoxelCounter(GRID)
    for start in range(0, len(xyz), chunk):
        counter.add(xyz[start : start + chunk])
    return counter.count


@pytest.mark.parametrize("chunk", [1, 7, 100])
def test_small_scans_are_counted_exactly(chunk: int) -> None:
    xyz = np.random.default_rng(0).random((100, 3)) * 4
    xyz[3] = np.nan
    assert count(xyz, chunk) == len(np.unique(GRID.keys(xyz[np.isfinite(xyz).all(axis=1)])))
    assert count(xyz[:0], 1) == 0


def test_large_ones_nearly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(voxel_count, "_MOST_KEYS", 4096)
    xyz = np.random.default_rng(1).random((200_000, 3)) * [60, 60, 8]
    true = len(np.unique(GRID.keys(xyz)))
    assert true > 80_000
    assert count(xyz, 10_000) == pytest.approx(true, rel=0.05)
