import struct
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import ReadError
from bushseg.io.memory import MemoryReader
from bushseg.io.pcd import create_pcd, open_pcd
from bushseg.points import PointCloud

HEADER = (
    "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n"
)


@pytest.mark.parametrize("name", ["ascii.pcd", "binary.pcd", "compressed.pcd"])
def test_reads_each_encoding(
    tmp_path: Path, samples: dict[str, bytes], xyz: np.ndarray, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(samples[name])
    scan = open_pcd(path)
    points = scan.read()
    np.testing.assert_array_equal(points.xyz, xyz)
    assert set(points.attributes) == {"ring", "label"}  # "_" is padding
    assert points.attributes["ring"].tolist() == [65535, 3]
    assert points.attributes["ring"].dtype == np.uint16
    assert points.attributes["label"].tolist() == [-1, 9]
    assert scan.info.label_attribute == "label"
    assert scan.info.sensor_position is not None
    assert scan.info.sensor_position.tolist() == [10, 20, 30]
    assert [len(chunk) for chunk in scan.chunks(1)] == [1, 1]


def test_keeps_nan_points_of_an_organized_cloud(tmp_path: Path) -> None:
    path = tmp_path / "organized.pcd"
    path.write_text(
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 2\nDATA ascii\n"
        "nan nan nan\n1 2 3\nnan nan nan\n4 5 6\n"
    )
    xyz = open_pcd(path).read().xyz
    assert np.isnan(xyz[[0, 2]]).all()
    assert xyz[[1, 3]].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_multi_valued_fields_keep_their_shape(tmp_path: Path) -> None:
    path = tmp_path / "multi.pcd"
    path.write_text(
        "FIELDS x y z fpfh\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 3\nWIDTH 2\nHEIGHT 1\n"
        "POINTS 2\nDATA ascii\n0 0 0 1 2 3\n0 0 1 4 5 6\n"
    )
    scan = open_pcd(path)
    assert scan.info.attributes["fpfh"] == np.dtype(("f4", (3,)))
    assert scan.read().attributes["fpfh"].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_names_in_any_language(tmp_path: Path) -> None:
    path = tmp_path / "names.pcd"
    path.write_bytes(
        "FIELDS x y z à 高さ\nSIZE 4 4 4 1 1\nTYPE F F F U U\nWIDTH 1\nHEIGHT 1\n"
        "DATA ascii\n0 0 0 1 2\n".encode()
    )
    assert list(open_pcd(path).read().attributes) == ["à", "高さ"]


def test_large_integers_in_text_stay_exact(tmp_path: Path) -> None:
    path = tmp_path / "time.pcd"
    path.write_text(
        "FIELDS x y z t\nSIZE 4 4 4 8\nTYPE F F F U\nWIDTH 1\nHEIGHT 1\nDATA ascii\n"
        f"0 0 0 {2**64 - 1}\n"
    )
    assert open_pcd(path).read().attributes["t"].tolist() == [2**64 - 1]


def test_default_viewpoint_is_no_position(tmp_path: Path) -> None:
    path = tmp_path / "plain.pcd"
    path.write_bytes(HEADER.encode() + bytes(24))
    assert open_pcd(path).info.sensor_position is None


def test_writes_the_sensor_position(tmp_path: Path) -> None:
    points = PointCloud(np.zeros((1, 3)))
    source = MemoryReader(points, sensor=[0.1, -2.0, 1e6])
    with create_pcd(tmp_path / "out.pcd", source, {}) as writer:
        writer.write(points, {}, None)
    position = open_pcd(tmp_path / "out.pcd").info.sensor_position
    assert position is not None
    assert position.tolist() == [0.1, -2.0, 1e6]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("POINTS 2", "POINTS 3", "POINTS 3 but"),
        ("POINTS 2", "POINTS -2", "POINTS -2"),
        ("WIDTH 2", "WIDTH two", "WIDTH two"),
        ("WIDTH 2\nHEIGHT 1", f"WIDTH {2**60}\nHEIGHT 1", "POINTS 2 but"),
        ("SIZE 4 4 4", "SIZE 4 4", "2 SIZE"),
        ("SIZE 4 4 4", "SIZE 4 4 3", "SIZE 3"),
        ("TYPE F F F", "TYPE F F X", "TYPE X"),
        ("COUNT 1 1 1", "COUNT 1 1 0", "COUNT of 1"),
        ("COUNT 1 1 1", "COUNT 1 1 2", "truncated"),
        ("COUNT 1 1 1", f"COUNT 1 1 {2**40}", "bytes a point"),
        ("FIELDS x y z", "FIELDS x y x", "twice"),
        ("FIELDS x y z", "FIELDS x y w", "x, y and z"),
        ("FIELDS x y z\n", "", "0 FIELDS"),
        ("VIEWPOINT 0", "VIEWPOINT a", "VIEWPOINT"),
        ("DATA binary", "DATA zipped", "DATA zipped"),
        ("DATA binary\n", "", "DATA"),
    ],
)
def test_refuses_malformed_headers(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in HEADER
    path = tmp_path / "bad.pcd"
    path.write_bytes(HEADER.replace(old, new).encode() + bytes(24))
    with pytest.raises(ReadError, match=message):
        open_pcd(path)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("count", [3, 2**60])
def test_refuses_more_points_than_the_file_holds(tmp_path: Path, encoding: str, count: int) -> None:
    header = HEADER.replace("WIDTH 2", f"WIDTH {count}").replace("POINTS 2", f"POINTS {count}")
    bodies = {
        "ascii": b"0 0 0\n0 0 0\n",
        "binary": bytes(24),
        "binary_compressed": struct.pack("<II", 3, 24) + b"\x00\x00\x00",
    }
    path = tmp_path / "bad.pcd"
    path.write_bytes(header.replace("DATA binary", f"DATA {encoding}").encode() + bodies[encoding])
    with pytest.raises(ReadError, match="in its header"):
        open_pcd(path)


def test_refuses_a_damaged_compressed_body(tmp_path: Path) -> None:
    path = tmp_path / "bad.pcd"
    body = struct.pack("<II", 2, 24) + b"\xe0\xff"
    path.write_bytes(HEADER.replace("DATA binary", "DATA binary_compressed").encode() + body)
    with pytest.raises(ReadError, match="damaged"):
        open_pcd(path).read()
