"""KITTI and RELLIS-3D frames: `.bin` of float32 x, y, z, intensity, and a `.label` beside it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.errors import ReadError
from bushseg.io.base import CHUNK_POINTS, ScanInfo, ScanReader
from bushseg.io.codes import KITTI_CLASS_BITS, KITTI_DTYPE, check_label_size
from bushseg.io.sniff import check_file
from bushseg.io.stream import Table
from bushseg.io.table import TableReader

_DTYPE = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
# The folder of frames, and the folder beside it that holds their labels.
_LABEL_FOLDERS = {
    "velodyne": "labels",
    "os1_cloud_node_kitti_bin": "os1_cloud_node_semantickitti_label_id",
}
_LARGEST_COORDINATE = 1e6
_SMALLEST_COORDINATE = 1e-4


class KittiReader(TableReader):
    """An open frame, with its labels if it has any."""

    def __init__(self, info: ScanInfo, label_path: Path | None) -> None:
        super().__init__(info, ("x", "y", "z"))
        self._label_path = label_path

    def _tables(self, size: int) -> Iterator[Table]:
        columns = {
            name: self.info.attributes[name]
            for name in ("label", "instance")
            if name in self.info.attributes
        }
        dtype = np.dtype([*((name, "<f4") for name in _DTYPE.names or ()), *columns.items()])
        for start in range(0, self.info.num_points, size):
            points = np.fromfile(
                self.info.path, dtype=_DTYPE, count=size, offset=start * _DTYPE.itemsize
            )
            if self._label_path is None:
                yield points
                continue
            packed = np.fromfile(
                self._label_path, KITTI_DTYPE, len(points), offset=start * KITTI_DTYPE.itemsize
            )
            table = np.empty(len(packed), dtype=dtype)
            for name in _DTYPE.names or ():
                table[name] = points[name][: len(packed)]
            table["label"] = packed & ((1 << KITTI_CLASS_BITS) - 1)
            if "instance" in columns:
                table["instance"] = packed >> KITTI_CLASS_BITS
            yield table


def open_kitti(path: Path) -> ScanReader:
    """Open a frame.

    Its labels are the file of the same stem and the suffix `.label`, in the same folder or in the
    one KITTI (`labels`) or RELLIS-3D (`os1_cloud_node_semantickitti_label_id`) has for them.
    Points at exactly (0, 0, 0) are pulses that did not return; they are kept. Coordinates are the
    sensor's own, so the sensor stands at the origin.

    Raises:
        ReadError: The size isn't a whole number of points, the content isn't coordinates, or the
            labels are of another number.
    """
    size = path.stat().st_size
    if size % _DTYPE.itemsize:
        raise ReadError(
            path, f"{size:,} bytes", "a multiple of 16 (float32 x y z intensity a point)"
        )
    num_points = size // _DTYPE.itemsize
    _check_coordinates(path)
    attributes: dict[str, np.dtype[Any]] = {"intensity": np.dtype("f4")}
    label_path = find_labels(path)
    if label_path is not None:
        check_file(label_path)
        num_labels = check_label_size(label_path)
        if num_labels != num_points:
            raise ReadError(
                label_path, f"{num_labels:,} labels", f"{num_points:,}, one a point of {path.name}"
            )
        attributes["label"] = np.dtype("u2")
        if _has_instances(label_path):
            attributes["instance"] = np.dtype("u2")
    info = ScanInfo(
        path=path,
        format="KITTI float32 x y z intensity",
        num_points=num_points,
        attributes=attributes,
        label_attribute=None if label_path is None else "label",
        sensor_position=np.zeros(3),
        no_returns_at_origin=True,
    )
    return KittiReader(info, label_path)


def _check_coordinates(path: Path) -> None:
    """Refuse bytes that are not float32 coordinates: the format has no header to tell by."""
    points = np.fromfile(path, dtype=_DTYPE, count=CHUNK_POINTS)
    size = np.abs(np.stack([points[name] for name in ("x", "y", "z")]))
    zero = size == 0
    if zero.all():
        raise ReadError(path, "nothing but zeros", "points; copy or download the file again")
    plausible = zero | ((size >= _SMALLEST_COORDINATE) & (size <= _LARGEST_COORDINATE))
    if plausible.mean() < 0.5:
        raise ReadError(
            path,
            f"{1 - plausible.mean():.0%} of the coordinates not finite, beyond 1000 km or below "
            "0.1 mm",
            "float32 x y z intensity in metres, little-endian, and no header",
        )


def find_labels(path: Path) -> Path | None:
    """The frame's labels, if they stand where they are looked for."""
    beside = path.with_suffix(".label")
    sibling = _LABEL_FOLDERS.get(path.parent.name)
    candidates = [beside]
    if sibling is not None:
        candidates.append(path.absolute().parent.parent / sibling / beside.name)
    return next((candidate for candidate in candidates if candidate.exists()), None)


def _has_instances(path: Path) -> bool:
    packed = np.memmap(path, dtype=KITTI_DTYPE, mode="r")
    return any(
        bool((packed[start : start + CHUNK_POINTS] >> KITTI_CLASS_BITS).any())
        for start in range(0, len(packed), CHUNK_POINTS)
    )
