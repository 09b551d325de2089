"""Scans read by libraries that share no code with bushseg: what its readers are held against.

LAS by laspy, PLY by plyfile, PCD by Open3D, E57 by pye57, frames and text by numpy.
"""

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.geometry import open3d

Columns = dict[str, NDArray[Any]]

_E57_FIELDS = ("cartesianX", "cartesianY", "cartesianZ", "cartesianInvalidState")


def read_columns(path: Path) -> Columns:
    """Read a scan.

    Returns:
        "xyz", shape (N, 3), float64, and the attributes that the library gives under the same name
        as bushseg does, each of length N.

    Raises:
        Exception: Whatever the library raises; some abort the process instead.
    """
    return _READERS[path.suffix.lower()](path)


def _read_las(path: Path) -> Columns:
    import laspy

    las = laspy.read(path)
    names = [name for name in las.point_format.dimension_names if name not in ("X", "Y", "Z")]
    return {"xyz": np.array(las.xyz), **{name: np.array(las[name]) for name in names}}


def _read_ply(path: Path) -> Columns:
    import plyfile

    vertex = plyfile.PlyData.read(path)["vertex"]
    names = [item.name for item in vertex.properties if item.name not in "xyz"]
    return {"xyz": _stack(vertex, "xyz"), **{name: np.array(vertex[name]) for name in names}}


def _read_pcd(path: Path) -> Columns:
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
    return columns


def _read_frame(path: Path) -> Columns:
    rows = np.fromfile(path, "<f4").reshape(-1, 4)
    columns: Columns = {"xyz": rows[:, :3].astype(np.float64), "intensity": rows[:, 3]}
    if path.with_suffix(".label").exists():
        columns["label"] = np.fromfile(path.with_suffix(".label"), "<u4") & 0xFFFF
    return columns


def _read_text(path: Path) -> Columns:
    return {"xyz": np.loadtxt(path, usecols=(0, 1, 2), ndmin=2)}


def _read_e57(path: Path) -> Columns:
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
    return {"xyz": np.concatenate(clouds)}


def _stack(columns: Any, names: Any) -> NDArray[np.float64]:
    return np.stack([np.asarray(columns[name], dtype=np.float64) for name in names], axis=1)


_READERS: dict[str, Callable[[Path], Columns]] = {
    ".bin": _read_frame,
    ".e57": _read_e57,
    ".las": _read_las,
    ".laz": _read_las,
    ".pcd": _read_pcd,
    ".ply": _read_ply,
    ".txt": _read_text,
    ".xyz": _read_text,
}
