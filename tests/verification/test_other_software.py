"""Outputs opened by others' software: laspy, plyfile and Open3D here and now.

With `make test-pdal`, by PDAL, by LASzip itself and by CloudCompare too, each if it is installed.
"""

import csv
import json
import os
import shutil
import subprocess

import laspy
import numpy as np
import plyfile
import pytest

from bushseg.geometry import open3d

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")

EXTRAS = (
    laspy.ExtraBytesParams("height", "f4"),
    laspy.ExtraBytesParams("scaled", "i2", scales=np.array([0.1]), offsets=np.array([5.0])),
)
FORMATS = [("1.2", 3), ("1.3", 1), ("1.4", 6), ("1.4", 7), ("1.4", 8)]
PDAL_NAMES = {
    "ReturnNumber": "return_number",
    "NumberOfReturns": "number_of_returns",
    "Classification": "classification",
    "PointSourceId": "point_source_id",
    "UserData": "user_data",
    "GpsTime": "gps_time",
    "Intensity": "intensity",
    "Red": "red",
    "Green": "green",
    "Blue": "blue",
    "Infrared": "nir",
    **{name: name for name in ("height", "scaled", "class_index", "confidence")},
}


@pytest.fixture
def labeled(write, label, recipe, tmp_path):
    """Write a scan and label it: `labeled("out.las", "1.4", 7)`."""

    def make(name, version, point_format):
        source = write(tmp_path / "in.las", recipe(version, point_format, EXTRAS))
        return label(source, tmp_path / name)

    return make


def program(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} isn't on PATH")
    return path


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_laspy_reads_every_dimension(labeled, tmp_path, suffix):
    before, after = laspy.read(labeled(f"out{suffix}", "1.4", 7)), laspy.read(tmp_path / "in.las")
    for name in after.point_format.dimension_names:
        if name != "classification":
            np.testing.assert_array_equal(np.asarray(before[name]), np.asarray(after[name]))
    assert before.class_index.dtype == np.uint8
    assert before.confidence.dtype == np.float32


def test_plyfile_and_open3d_read_the_same_ply(labeled):
    path = labeled("out.ply", "1.4", 7)
    vertex = plyfile.PlyData.read(path)["vertex"]
    cloud = open3d().t.io.read_point_cloud(str(path))
    xyz = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    np.testing.assert_array_equal(cloud.point.positions.numpy(), xyz)
    read = dict(cloud.point.items())
    for item in vertex.properties:
        if item.val_dtype not in ("i2", "u2") and item.name not in "xyz":  # Open3D passes over them
            np.testing.assert_array_equal(read[item.name].numpy()[:, 0], vertex[item.name])


@pytest.mark.pdal
@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(("version", "point_format"), FORMATS)
def test_pdal_reads_every_dimension(labeled, tmp_path, version, point_format, suffix):
    pdal, path = program("pdal"), labeled(f"out{suffix}", version, point_format)
    las = laspy.read(path)
    reader = {"type": "readers.las", "filename": str(path), "use_eb_vlr": True}
    options = ["--all", "--readers.las.use_eb_vlr=true"]
    said = subprocess.run([pdal, "info", *options, path], capture_output=True, check=True)
    assert json.loads(said.stdout)["metadata"]["count"] == len(las.points)
    target = tmp_path / "pdal.csv"
    writer = {
        "type": "writers.text",
        "filename": str(target),
        "format": "csv",
        "precision": 17,
        "quote_header": False,
    }
    pipeline = json.dumps([reader, writer])
    subprocess.run([pdal, "pipeline", "--stdin"], input=pipeline.encode(), check=True)
    with target.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(las.points)
    for axis in "XYZ":
        found = np.array([float(row[axis]) for row in rows])
        np.testing.assert_allclose(found, las[axis.lower()], rtol=0, atol=1e-6)
    for name, ours in PDAL_NAMES.items():
        if ours in las.point_format.dimension_names:
            found = np.array([float(row[name]) for row in rows])
            np.testing.assert_allclose(found, np.asarray(las[ours]), rtol=1e-12, err_msg=name)


@pytest.mark.pdal
@pytest.mark.parametrize(("version", "point_format"), FORMATS)
def test_laszip_decompresses_what_was_compressed(labeled, version, point_format):
    """The reference implementation, in C++, which shares nothing with lazrs."""
    pytest.importorskip("laszip", reason="the package laszip isn't installed")
    path = labeled("out.laz", version, point_format)
    with laspy.open(path, laz_backend=laspy.LazBackend.Laszip) as reader:
        found = reader.read().points.array
    np.testing.assert_array_equal(found.view("u1"), laspy.read(path).points.array.copy().view("u1"))


@pytest.mark.pdal
def test_cloudcompare_reads_the_ply(labeled, tmp_path):
    command = program("CloudCompare")
    path = labeled("out.ply", "1.4", 7)
    options = ["-SILENT", "-AUTO_SAVE", "OFF", "-O", "-GLOBAL_SHIFT", "AUTO", str(path)]
    options += ["-C_EXPORT_FMT", "ASC", "-PREC", "9", "-ADD_HEADER", "-SAVE_CLOUDS"]
    options += ["FILE", str(tmp_path / "cc.asc")]
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    subprocess.run([command, *options], env=environment, check=True, capture_output=True)
    lines = (tmp_path / "cc.asc").read_text().splitlines()
    names = lines[0].lstrip("/").split()
    table = np.array([[float(word) for word in line.split()] for line in lines[1:]])
    vertex = plyfile.PlyData.read(path)["vertex"]
    assert len(table) == vertex.count
    for axis in range(3):
        np.testing.assert_allclose(table[:, axis], vertex["xyz"[axis]], rtol=0, atol=1e-3)
    # Unless someone ticks them in its dialog, it takes no other columns than these.
    at = names.index("intensity")
    np.testing.assert_array_equal(table[:, at], vertex["intensity"])
    np.testing.assert_allclose(table[:, names.index("scaled")], vertex["scaled"], rtol=1e-6)
