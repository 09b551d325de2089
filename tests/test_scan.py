"""A scan at voxel resolution, streamed in chunks: what is kept, skipped, counted and refused."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import DataError
from bushseg.io.memory import MemoryReader
from bushseg.labels import SCHEMES
from bushseg.points import PointCloud
from bushseg.scan import mask_no_returns, read_voxels

BUSH = SCHEMES["bush"]
OFFSET = np.array([1e6, 6.6e6, 50])
XYZ = OFFSET + np.array([[0.1, 0, 0], [0.12, 0, 0], [5, 0, 0], [np.nan, 0, 0], [0, 0, 0]])


class Chunked(MemoryReader):
    """Points in memory that arrive a few at a time, with what a file's header may say."""

    def __init__(self, cloud: PointCloud, chunk: int = 2, **info: object) -> None:
        super().__init__(cloud)
        self.chunk = chunk
        self.info = replace(self.info, **info)  # type: ignore[arg-type]

    def chunks(self, size: int = 0) -> Iterator[PointCloud]:
        return super().chunks(self.chunk)


def cloud(**attributes: list[int]) -> PointCloud:
    return PointCloud(XYZ, {name: np.array(values) for name, values in attributes.items()})


@pytest.mark.parametrize("chunk", [1, 2, 5])
def test_points_become_voxels_with_features_and_labels(chunk: int) -> None:
    points = cloud(code=[4, 4, 2, 5, 99], intensity=[10, 30, 90, 7, 60])
    scan = read_voxels(Chunked(points, chunk, label_attribute="code"), 0.5, BUSH)
    assert scan.num_points == 5
    assert scan.num_skipped == 1
    assert scan.unknown.codes == {99: 1}
    assert sorted(scan.voxels.counts.tolist()) == [1, 3]
    near = int(scan.voxels.counts.argmax())
    assert scan.voxels.labels is not None
    assert scan.voxels.labels[[near, 1 - near]].tolist() == [2, 0]
    assert set(scan.features) == {"intensity", "height"}
    mean = scan.voxels.xyz[near] + scan.voxels.grid.origin
    np.testing.assert_allclose(mean, [1e6 + 0.22 / 3, 6.6e6, 50], atol=1e-9)


def test_labels_are_left_alone_without_a_scheme_or_an_attribute() -> None:
    reader = Chunked(cloud(code=[4] * 5), label_attribute="code")
    assert read_voxels(reader, 0.5).voxels.labels is None
    assert read_voxels(Chunked(cloud(code=[4] * 5)), 0.5, BUSH).voxels.labels is None


def test_a_label_field_that_is_named_wins_and_must_exist() -> None:
    reader = Chunked(cloud(code=[4] * 5, other=[2] * 5), label_attribute="code")
    labels = read_voxels(reader, 0.5, BUSH, "other").voxels.labels
    assert labels is not None
    assert set(labels.tolist()) == {0}
    with pytest.raises(DataError, match="no attribute 'third'; it has code, other"):
        read_voxels(reader, 0.5, BUSH, "third")


@pytest.mark.parametrize("count", [0, 3])
def test_a_scan_without_a_finite_point_is_refused(count: int) -> None:
    with pytest.raises(DataError, match=f"none of its {count} points"):
        read_voxels(Chunked(PointCloud(np.full((count, 3), np.nan))), 0.5)


def test_bad_points_at_the_start_are_skipped_and_counted() -> None:
    xyz = np.concatenate([np.full((5, 3), np.inf), np.zeros((2, 3))])
    scan = read_voxels(Chunked(PointCloud(xyz)), 0.5)
    assert (scan.num_points, scan.num_skipped, len(scan.voxels)) == (7, 5, 1)


def test_a_stray_first_point_does_not_take_the_grid_along() -> None:
    xyz = np.concatenate([[[1e20, 0, 0]], np.arange(30.0).reshape(10, 3)])
    scan = read_voxels(Chunked(PointCloud(xyz), 11), 0.5)
    assert (len(scan.voxels), scan.num_skipped) == (10, 1)


def test_a_moved_scan_keeps_its_voxels() -> None:
    xyz = np.random.default_rng(0).integers(0, 4096, (400, 3)) / 256
    here, there = (read_voxels(MemoryReader(PointCloud(it)), 0.5) for it in (xyz, xyz + 2.0**20))
    np.testing.assert_array_equal(here.voxels.keys, there.voxels.keys)
    np.testing.assert_allclose(here.voxels.xyz, there.voxels.xyz, atol=1e-6)


def test_no_returns_take_no_voxel() -> None:
    xyz = np.array([[0.0, 0, 0], [3, 0, 0], [0, 0, 0], [0, 0, 1e-9]])
    reader = Chunked(PointCloud(xyz), no_returns_at_origin=True)
    scan = read_voxels(reader, 0.5)
    assert (scan.num_points, scan.num_skipped, len(scan.voxels)) == (4, 2, 2)
    assert mask_no_returns(xyz, Chunked(PointCloud(xyz))) is xyz
    assert np.isnan(mask_no_returns(xyz, reader)).all(axis=1).tolist() == [True, False, True, False]
    assert (xyz[0] == 0).all()


def test_the_sensor_moves_with_the_scan() -> None:
    sensor = XYZ[0] + [0, 0, 2]
    scan = read_voxels(MemoryReader(PointCloud(XYZ), sensor), 0.5)
    assert scan.sensor is not None
    np.testing.assert_allclose(scan.sensor + scan.voxels.grid.origin, sensor, atol=1e-9)
    assert read_voxels(MemoryReader(PointCloud(XYZ)), 0.5).sensor is None


def test_a_message_names_the_scan() -> None:
    reader = Chunked(PointCloud(np.empty((0, 3))), path=Path("site.las"))
    with pytest.raises(DataError, match=r"^site\.las"):
        read_voxels(reader, 0.5)
