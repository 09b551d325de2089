"""Normals of a whole scan: the same in one piece and in several, however often it is stopped."""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bushseg import voxel_normals as module
from bushseg.io.memory import MemoryReader
from bushseg.points import PointCloud
from bushseg.scan import VoxelScan, read_voxels
from bushseg.stages import Stages
from bushseg.stored_scan import open_stored, store_scan
from bushseg.tiling import Tiling
from bushseg.voxel_normals import voxel_normals

Normals = tuple[np.ndarray, np.ndarray]


def normals_of(scan: VoxelScan, num_neighbors: int, stages: Stages | None = None) -> Normals:
    tiling = Tiling(scan.voxels.keys, 1000, 16, scan.voxels.scratch)
    return voxel_normals(scan, tiling, num_neighbors, stages or Stages())


def rough_ground() -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.random((4_000, 3)) * [20, 20, 1] + [500_000, 6_600_000, 0]


@pytest.mark.parametrize("sensor", [None, (3.0, 2.0, -4.0)])
def test_pieces_give_what_the_whole_gives(
    monkeypatch: pytest.MonkeyPatch, sensor: tuple[float, ...] | None
) -> None:
    xyz = rough_ground()
    place = None if sensor is None else xyz[0] + sensor
    scan = read_voxels(MemoryReader(PointCloud(xyz), place), 0.2)
    stages = Stages()
    whole, whole_distances = normals_of(scan, 12, stages)
    assert set(stages.seconds) == {"tiling", "neighbors", "normals"}
    monkeypatch.setattr(module, "_TILE_POINTS", 700)
    pieces, distances = normals_of(scan, 12)
    np.testing.assert_array_equal(distances, whole_distances)
    # The sensor's place is rounded with each piece's origin.
    np.testing.assert_allclose(pieces, whole, atol=1e-6)


def test_a_floor_points_up_and_its_neighbors_are_a_voxel_away() -> None:
    x, y = np.meshgrid(np.arange(30) * 0.5, np.arange(20) * 0.5)
    xyz = np.column_stack([x.ravel(), y.ravel(), np.zeros(600)])
    scan = read_voxels(MemoryReader(PointCloud(xyz)), 0.5)
    normals, distances = normals_of(scan, 5)  # itself and the four beside it
    np.testing.assert_allclose(normals, np.tile([0, 0, 1], (600, 1)), atol=1e-6)
    assert np.median(distances) == pytest.approx(0.5, abs=1e-3)


Run = Callable[..., int]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Estimates the normals of a stored scan; says how many pieces it did."""
    monkeypatch.setattr(module, "_TILE_POINTS", 700)
    honest = module.estimate_normals
    reader = MemoryReader(PointCloud(rough_ground()))
    stored = read_voxels(reader, 0.2, folder=tmp_path, on_disk=True)
    store_scan(stored, Tiling(stored.voxels.keys, 1000, 16, stored.voxels.scratch))
    expected = normals_of(read_voxels(reader, 0.2), 12)

    def estimate(stop_at: int | None = None) -> int:
        pieces = itertools.count()

        def watched(*args: object) -> np.ndarray:
            number = next(pieces)
            if number == stop_at:
                raise KeyboardInterrupt
            return honest(*args)

        monkeypatch.setattr(module, "estimate_normals", watched)
        scan, tiling = open_stored(tmp_path)
        before = list(tiling.tiles)
        try:
            found = voxel_normals(scan, tiling, 12, Stages())
        except KeyboardInterrupt:
            assert stop_at is not None
        else:
            for ours, theirs in zip(found, expected, strict=True):
                np.testing.assert_array_equal(ours, theirs)
        assert tiling.tiles == before
        return next(pieces)

    return estimate


def test_pieces_that_are_done_are_not_done_again(run: Run) -> None:
    whole = run()
    assert whole > 4
    assert run() == 0


def test_a_stopped_run_loses_the_piece_it_was_at(run: Run, tmp_path: Path) -> None:
    whole = run()
    (tmp_path / "normals.json").unlink()
    assert run(stop_at=2) == 3
    assert run(stop_at=1) == 2
    assert run() == whole - 3


@pytest.mark.parametrize("name", ["normals", "distances", "normals.json"])
@pytest.mark.parametrize("damage", [b"", b"{}", b'{"version": 4, "num_done": 99, "num_pieces": 1}'])
def test_what_is_damaged_is_done_again(run: Run, tmp_path: Path, name: str, damage: bytes) -> None:
    whole = run()
    (tmp_path / name).write_bytes(damage)
    assert run(stop_at=2) == 3
    assert run() == whole - 2


@pytest.mark.parametrize("name", ["normals", "distances", "normals.json"])
def test_what_is_gone_is_done_again(run: Run, tmp_path: Path, name: str) -> None:
    whole = run()
    (tmp_path / name).unlink()
    assert run() == whole
