import struct
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import ReadError, WriteError
from bushseg.io.memory import MemoryReader
from bushseg.io.ply import create_ply, open_ply
from bushseg.points import PointCloud

HEADER = b"ply\nformat %s 1.0\nelement vertex %d\n%send_header\n"
PROPERTIES = b"property float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize("name", ["ascii.ply", "little.ply", "big.ply"])
def test_reads_each_encoding(
    tmp_path: Path, samples: dict[str, bytes], xyz: np.ndarray, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(samples[name])
    scan = open_ply(path)
    points = scan.read()
    np.testing.assert_array_equal(points.xyz, xyz)
    assert points.attributes["red"].tolist() == [255, 7]
    assert points.attributes["red"].dtype == np.uint8
    assert points.attributes["scalar_Classification"].tolist() == [-1, 300]
    assert points.attributes["scalar_Classification"].dtype == np.dtype("=i2")
    assert scan.info.label_attribute == "scalar_Classification"
    assert scan.info.num_points == 2
    assert dict(scan.info.attributes) == {
        "red": np.dtype("u1"),
        "scalar_Classification": np.dtype("i2"),
    }


@pytest.mark.parametrize("name", ["ascii.ply", "little.ply"])
def test_chunks_can_be_read_again(tmp_path: Path, samples: dict[str, bytes], name: str) -> None:
    path = tmp_path / name
    path.write_bytes(samples[name])
    scan = open_ply(path)
    for _ in range(2):
        assert [len(chunk) for chunk in scan.chunks(1)] == [1, 1]


def test_all_types_under_both_names(tmp_path: Path) -> None:
    kinds = "char int8 uchar uint8 short int16 ushort uint16 int int32 uint uint32 float32 float64"
    codes = "bbBBhhHHiiIIfd"
    names = "".join(f"property {kind} a{index}\n" for index, kind in enumerate(kinds.split()))
    path = tmp_path / "types.ply"
    path.write_bytes(
        HEADER % (b"binary_big_endian", 1, PROPERTIES + names.encode())
        + struct.pack(">3f" + codes, 1, 2, 3, *range(len(codes)))
    )
    points = open_ply(path).read()
    for index, code in enumerate(codes):
        assert points.attributes[f"a{index}"].dtype == np.dtype(code)
        assert points.attributes[f"a{index}"].tolist() == [index]


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_passes_over_lists_before_the_vertices(tmp_path: Path, encoding: str) -> None:
    header = (
        f"ply\r\nformat {encoding} 1.0\r\nelement face 2\r\nproperty uchar flag\r\n"
        "property list ushort int vertex_indices\r\nelement empty 0\r\n"
        "element vertex 1\r\nproperty int x\r\nproperty int y\r\nproperty int z\r\nend_header\r\n"
    ).encode()
    path = tmp_path / "faces.ply"
    if encoding == "ascii":
        body = b"1 3 0 1 2\r\n0 0\r\n7 8 9\r\n"
    else:
        body = struct.pack("<BH3i", 1, 3, 0, 1, 2) + struct.pack("<BH", 0, 0)
        body += struct.pack("<3i", 7, 8, 9)
    path.write_bytes(header + body)
    assert open_ply(path).read().xyz.tolist() == [[7, 8, 9]]


def test_names_and_comments_in_any_language(tmp_path: Path) -> None:
    header = (
        "ply\nformat ascii 1.0\ncomment levé à pied\n\nelement vertex 1\nobj_info 1 scan\n"
        + PROPERTIES.decode()
        + "property uchar scalar_à\nproperty uchar 高さ\nproperty uchar 50%25\nend_header \n"
    )
    path = tmp_path / "names.ply"
    path.write_bytes(header.encode() + b"0 0 0 1 2 3\n")
    assert list(open_ply(path).read().attributes) == ["scalar_à", "高さ", "50%25"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"plx\n", "no 'ply'"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\n", "without an end"),
        (b"ply\nelement vertex 1\nend_header\n", "line 2"),
        (b"ply\nformat ascii 2.0\nend_header\n", "line 2"),
        (b"ply\nformat ascii 1.0\nend_header\n", "no vertex element"),
        (b"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "line 3"),
        (b"ply\nformat ascii 1.0\nelement vertex 1_000\nend_header\n", "line 3"),
        (b"ply\nformat ascii 1.0\nelement\x1cvertex\x1c%d\nend_header\n" % 2**40, "line 3"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list float int n\nend_header\n",
            "float",
        ),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "line 3"),
        (HEADER % (b"ascii", 0, PROPERTIES), "0 vertices"),
        (HEADER % (b"ascii", 1, b"property float x\n"), "x, y and z"),
        (HEADER % (b"ascii", 1, PROPERTIES * 2), "same name"),
        (HEADER % (b"ascii", 1, b"property char \xe9\nproperty char \\xe9\n"), "more than once"),
        (HEADER % (b"ascii", 1, b"property float128 x\n"), "line 4"),
        (HEADER % (b"ascii", 1, PROPERTIES + b"property list int int n\n"), "list property"),
        (HEADER % (b"ascii", 2**60, PROPERTIES) + b"0 0 0\n", "truncated"),
        (HEADER % (b"binary_little_endian", 2**60, PROPERTIES) + bytes(12), "truncated"),
        (HEADER % (b"binary_little_endian", 2, PROPERTIES) + bytes(23), "23 bytes"),
    ],
)
def test_refuses_at_the_header(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "bad.ply"
    path.write_bytes(content)
    with pytest.raises(ReadError, match=message):
        open_ply(path)


@pytest.mark.parametrize("count", [3, 2**60])
def test_refuses_truncated_lists_before_the_vertices(tmp_path: Path, count: int) -> None:
    path = tmp_path / "bad.ply"
    path.write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement face %d\n" % count
        + b"property list int int n\nelement vertex 1\n"
        + PROPERTIES
        + b"end_header\n"
        + struct.pack("<4i", 2**30, 0, 0, 0)
    )
    with pytest.raises(ReadError, match="truncated"):
        open_ply(path)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (b"0 0 0 0\n1 1 1\n1 1 1 1\n", "line 10 is '1 1 1'"),
        (b"0 0 0 0\n1 1 1 256\n1 1 1 1\n", "line 10 is '1 1 1 256'"),
        (b"0 0 0 0\n1 1 1 1\n1 1 oops 1\n", "line 11 is '1 1 oops 1'"),
        (b"0 0 0 0\n1111111 1 11111111 1\n", "2 points"),
    ],
)
def test_names_the_malformed_line(tmp_path: Path, rows: bytes, message: str) -> None:
    path = tmp_path / "bad.ply"
    path.write_bytes(HEADER % (b"ascii", 3, PROPERTIES + b"property uchar red\n") + rows)
    scan = open_ply(path)
    with pytest.raises(ReadError, match=message):
        scan.read()


def test_refuses_integers_it_would_round(tmp_path: Path) -> None:
    points = PointCloud(np.zeros((1, 3)), {"time": np.array([2**53 + 1])})
    source = MemoryReader(points)
    writer = create_ply(tmp_path / "out.ply", source, {})
    with pytest.raises(WriteError, match="time"):
        writer.write(points, {}, None)


def test_refuses_to_close_early(tmp_path: Path) -> None:
    writer = create_ply(tmp_path / "out.ply", MemoryReader(PointCloud(np.zeros((2, 3)))), {})
    writer.write(PointCloud(np.zeros((1, 3))), {}, None)
    with pytest.raises(WriteError, match="incomplete"):
        writer.close()
