"""Scans of any format, read by other libraries: what bushseg's readers are held against.

LAS by laspy, tables by NumPy, PLY with lists by plyfile, compressed PCD by Open3D, E57 by pye57.
"""

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.geometry import open3d
from bushseg.verification.las_container import read_container
from bushseg.verification.las_points import raw_points
from bushseg.verification.rows import Columns, Scan
from bushseg.verification.tables import open_frame, open_pcd, open_ply, open_text

_E57_FIELDS = ("cartesianX", "cartesianY", "cartesianZ", "cartesianInvalidState")
_CHUNK = 500_000


def read_columns(path: Path) -> Columns:
    """Read a whole scan.

    Returns:
        "xyz", shape (N, 3), float64, and the attributes that the library gives under the same name
        as bushseg does, each of length N.

    Raises:
        Exception: Whatever the library raises; some abort the process instead.
    """
    chunks = list(open_columns(path).chunks(_CHUNK))
    if not chunks:
        raise ValueError(f"{path}: no points")
    return {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}


def open_columns(path: Path) -> Scan:
    """Open a scan, by its suffix.

    Raises:
        ReadError: The suffix is unknown.
        Exception: Whatever the library raises.
    """
    opener = _OPENERS.get(path.suffix.lower())
    if opener is None:
        known = ", ".join(_OPENERS)
        raise ReadError(path, f"the suffix {path.suffix!r}", f"one that verify reads: {known}")
    return opener(path)


def _open_las(path: Path) -> Scan:
    """Laspy takes the records apart; another process decompresses them, in case that aborts."""
    import laspy

    container = read_container(path)
    with path.open("rb") as file:
        header = laspy.LasHeader.read_from(file)
    layout = header.point_format
    names = [name for name in layout.dimension_names if name not in ("X", "Y", "Z")]

    def chunks(size: int) -> Iterator[Columns]:
        for raw in raw_points(container, size):
            rows = raw.reshape(-1).view(layout.dtype())
            points = laspy.ScaleAwarePointRecord(rows, layout, header.scales, header.offsets)
            xyz = np.stack([np.asarray(points[axis]) for axis in "xyz"], axis=1)
            yield {"xyz": xyz, **{name: np.array(points[name]) for name in names}}

    return Scan(chunks)


def _open_ply(path: Path) -> Scan:
    found = open_ply(path)
    if found is not None:
        return found
    import plyfile

    vertex = plyfile.PlyData.read(path)["vertex"]
    names = [item.name for item in vertex.properties if item.name not in "xyz"]
    columns = {name: np.array(vertex[name]) for name in names}
    return _whole({"xyz": _stack(vertex, "xyz"), **columns})


def _open_pcd(path: Path) -> Scan:
    found = open_pcd(path)
    if found is not None:
        return found
    # Open3D takes rgb apart, keeps padding, and of a field's several values the first.
    cloud = open3d().t.io.read_point_cloud(
        str(path), remove_nan_points=False, remove_infinite_points=False
    )
    if "positions" not in cloud.point:
        raise ValueError("Open3D finds no points")
    columns = {"xyz": cloud.point.positions.numpy().astype(np.float64)}
    for name, column in cloud.point.items():
        if name not in ("positions", "colors", "normals", "_"):
            columns[name] = column.numpy()[:, 0]
    return _whole(columns, complete=False)


def _open_e57(path: Path) -> Scan:
    import pye57

    # pye57 may remove a file that it fails to open.
    with tempfile.TemporaryDirectory() as folder:
        copy = shutil.copy(path, folder)
        clouds = []
        with pye57.E57(str(copy)) as file:
            for index in range(file.scan_count):
                header = file.get_header(index)
                # Not all fields: pye57 can't hold 16-bit colors.
                fields = [name for name in _E57_FIELDS if name in header.point_fields]
                scan, buffers = file.make_buffers(fields, header.point_count)
                header.points.reader(buffers).read()
                xyz = _stack(scan, _E57_FIELDS[:3])
                xyz[scan.get(_E57_FIELDS[3], np.zeros(len(xyz))) != 0] = np.nan
                if header.has_pose():
                    xyz = xyz @ header.rotation_matrix.T + header.translation
                clouds.append(xyz)
    if not clouds:
        raise ValueError("pye57 finds no scans")
    return _whole({"xyz": np.concatenate(clouds)}, complete=False)


def _whole(columns: Columns, *, complete: bool = True) -> Scan:
    def chunks(size: int) -> Iterator[Columns]:
        for start in range(0, len(columns["xyz"]), size):
            yield {name: column[start : start + size] for name, column in columns.items()}

    return Scan(chunks, complete)


def _stack(columns: Any, names: Any) -> NDArray[np.float64]:
    return np.stack([np.asarray(columns[name], dtype=np.float64) for name in names], axis=1)


_OPENERS: dict[str, Callable[[Path], Scan]] = {
    ".bin": open_frame,
    ".csv": open_text,
    ".e57": _open_e57,
    ".las": _open_las,
    ".laz": _open_las,
    ".pcd": _open_pcd,
    ".ply": _open_ply,
    ".txt": open_text,
    ".xyz": open_text,
}
