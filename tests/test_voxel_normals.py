"""Normals of a whole scan: the same in one piece and in several."""

import numpy as np
import pytest

from bushseg import voxel_normals as module
from bushseg.io.memory import MemoryReader
from bushseg.points import PointCloud
from bushseg.scan import read_voxels
from bushseg.stages import Stages
from bushseg.voxel_normals import voxel_normals


@pytest.mark.parametrize("sensor", [None, (3.0, 2.0, -4.0)])
def test_pieces_give_what_the_whole_gives(
    monkeypatch: pytest.MonkeyPatch, sensor: tuple[float, ...] | None
) -> None:
    rng = np.random.default_rng(0)
    xyz = rng.random((4_000, 3)) * [20, 20, 1] + [500_000, 6_600_000, 0]
    place = None if sensor is None else xyz[0] + sensor
    scan = read_voxels(MemoryReader(PointCloud(xyz), place), 0.2)
    stages = Stages()
    whole, whole_distances = voxel_normals(scan, 12, stages)
    assert set(stages.seconds) == {"tiling", "neighbors", "normals"}
    monkeypatch.setattr(module, "_TILE_POINTS", 700)
    pieces, distances = voxel_normals(scan, 12, stages)
    np.testing.assert_array_equal(distances, whole_distances)
    # The sensor's place is rounded with each piece's origin.
    np.testing.assert_allclose(pieces, whole, atol=1e-6)


def test_a_floor_points_up_and_its_neighbors_are_a_voxel_away() -> None:
    x, y = np.meshgrid(np.arange(30) * 0.5, np.arange(20) * 0.5)
    xyz = np.column_stack([x.ravel(), y.ravel(), np.zeros(600)])
    scan = read_voxels(MemoryReader(PointCloud(xyz)), 0.5)
    normals, distances = voxel_normals(scan, 5, Stages())  # itself and the four beside it
    np.testing.assert_allclose(normals, np.tile([0, 0, 1], (600, 1)), atol=1e-6)
    assert np.median(distances) == pytest.approx(0.5, abs=1e-3)
