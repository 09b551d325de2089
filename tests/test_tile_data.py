"""A tile cut out of a scan: local float32 coordinates, labels in its core only, its own normals."""

import numpy as np
import pytest

from bushseg.config import PrepareConfig
from bushseg.io.memory import MemoryReader
from bushseg.labels import SCHEMES
from bushseg.points import PointCloud
from bushseg.scan import VoxelScan, read_voxels
from bushseg.stages import Stages
from bushseg.tile_data import NetworkTile, cut_points, cut_tile
from bushseg.tiling import Tiling
from bushseg.voxel_normals import voxel_normals

ORIGIN = np.array([500_000.25, 6_600_000.5, 120.0])
STEP = 0.25 / 1024
SETTINGS = PrepareConfig(voxel_size=0.25, num_neighbors=8, num_levels=2)


def make_scan(
    sensor: tuple[float, float, float] | None = None, origin: np.ndarray = ORIGIN
) -> VoxelScan:
    """A flat lawn of 30 x 10 m, all of it ground."""
    xyz = np.random.default_rng(0).random((20_000, 3)) * [30, 10, 0]
    xyz = np.round(xyz * 1024) / 1024 + origin
    points = PointCloud(xyz, {"code": np.full(len(xyz), 2)})
    place = None if sensor is None else origin + sensor
    return read_voxels(MemoryReader(points, place), 0.25, SCHEMES["bush"], "code")


def cut(scan: VoxelScan, halo: int = 16) -> list[NetworkTile]:
    tiling = Tiling(scan.voxels.keys, 1_500, halo)
    return [cut_tile(scan, tiling, tile, SETTINGS) for tile in tiling.tiles]


def test_a_tile_holds_its_voxels_relative_to_its_own_origin() -> None:
    scan = make_scan()
    tiles = cut(scan)
    assert len(tiles) > 2
    for tile in tiles:
        np.testing.assert_array_equal(tile.keys, scan.voxels.keys[tile.indices])
        np.testing.assert_array_equal(tile.counts, scan.voxels.counts[tile.indices])
        world = scan.voxels.xyz[tile.indices] + scan.voxels.grid.origin
        np.testing.assert_allclose(tile.xyz + tile.origin, world, atol=0.51 * STEP)
        assert np.abs(tile.xyz).max() < 20
        np.testing.assert_allclose(tile.xyz.mean(axis=0), 0, atol=STEP)
        assert tile.features["height"].shape == (len(tile), 1)
        assert len(tile.pyramid.neighbors[0]) == len(tile)
        dtypes = [tile.origin, tile.xyz, tile.normals, tile.labels, tile.counts]
        assert [str(column.dtype) for column in dtypes] == [
            "float64",
            "float32",
            "float32",
            "int16",
            "int32",
        ]


def test_labels_are_kept_in_the_core_and_hidden_in_the_halo() -> None:
    scan = make_scan()
    cores = np.zeros(len(scan.voxels), dtype=int)
    for tile in cut(scan):
        assert 0 < tile.is_core.sum() < len(tile)
        assert (tile.labels[tile.is_core] == 0).all()
        assert (tile.labels[~tile.is_core] == -1).all()
        cores[tile.indices[tile.is_core]] += 1
    assert (cores == 1).all()


@pytest.mark.parametrize(("height", "up"), [(None, 1), (2.0, 1), (-2.0, -1)])
def test_normals_point_up_or_to_the_sensor(height: float | None, up: int) -> None:
    tiles = cut(make_scan(None if height is None else (15.0, 5.0, height)))
    for tile in tiles:
        np.testing.assert_allclose(tile.normals, np.tile([0, 0, up], (len(tile), 1)), atol=1e-5)


def test_a_moved_scan_gives_the_same_tiles() -> None:
    for here, there in zip(cut(make_scan()), cut(make_scan(origin=np.zeros(3))), strict=True):
        np.testing.assert_array_equal(here.keys, there.keys)
        np.testing.assert_allclose(here.xyz, there.xyz, atol=1.01 * STEP)
        np.testing.assert_array_equal(here.is_core, there.is_core)
        same = here.pyramid.neighbors[0] == there.pyramid.neighbors[0]
        assert same.mean() > 0.999  # rounding may swap neighbors at equal distance


def test_voxels_lie_to_each_other_as_in_any_other_tile() -> None:
    scan = make_scan()
    first, second, *_ = cut(scan, halo=64)
    _, ours, theirs = np.intersect1d(first.indices, second.indices, return_indices=True)
    assert len(ours) > 1000
    assert (first.origin != second.origin).any()
    here, there = first.xyz[ours], second.xyz[theirs]
    np.testing.assert_array_equal(here[1:] - here[:-1], there[1:] - there[:-1])


def test_a_tile_of_points_alone_is_the_same_but_for_its_pyramid() -> None:
    scan = make_scan((15.0, 5.0, 2.0))
    tiling = Tiling(scan.voxels.keys, 1_500, 16)
    normals, _ = voxel_normals(scan, tiling, SETTINGS.num_neighbors, Stages())
    for tile in tiling.tiles:
        whole, bare = (
            cut_tile(scan, tiling, tile, SETTINGS),
            cut_points(scan, tiling, tile, normals),
        )
        for name in ("origin", "indices", "is_core", "keys", "xyz", "labels", "counts"):
            np.testing.assert_array_equal(getattr(bare, name), getattr(whole, name))
        np.testing.assert_array_equal(bare.features["height"], whole.features["height"])
        np.testing.assert_array_equal(bare.normals[bare.is_core], whole.normals[bare.is_core])
        again = NetworkTile.of(bare, SETTINGS).pyramid
        for ours, theirs in zip(again.neighbors, whole.pyramid.neighbors, strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_an_unlabelled_scan_has_tiles_too() -> None:
    points = PointCloud(np.random.default_rng(1).random((300, 3)))
    (tile,) = cut(read_voxels(MemoryReader(points), 0.25, SCHEMES["bush"]))
    assert (tile.labels == -1).all()


def test_the_neighbor_distance_is_the_median_reach_of_a_neighborhood() -> None:
    (tile,) = cut(read_voxels(MemoryReader(PointCloud(np.array([[0.0, 0, 0], [3, 4, 0]]))), 0.25))
    # Two points, K = 8: each row repeats both, and ends on the other one, 5 m away.
    assert tile.neighbor_distance() == pytest.approx(5)
