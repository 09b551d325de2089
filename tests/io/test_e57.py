import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import ReadError
from bushseg.io import base, e57
from bushseg.io.e57 import open_e57

pye57 = pytest.importorskip("pye57")

QUARTER_TURN = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # w, x, y, z: 90 degrees about z


def write_scans(path: Path, scans: list[dict], poses: list[tuple] | None = None) -> Path:
    with pye57.E57(str(path), mode="w") as file:
        for index, scan in enumerate(scans):
            rotation, translation = poses[index] if poses else (None, None)
            file.write_scan_raw(scan, rotation=rotation, translation=translation)
    return path


def columns(xyz: list[list[float]], **others: np.ndarray) -> dict:
    array = np.array(xyz, dtype=np.float64)
    return dict(zip(("cartesianX", "cartesianY", "cartesianZ"), array.T, strict=True), **others)


def test_poses_move_each_scan(tmp_path: Path) -> None:
    path = write_scans(
        tmp_path / "two.e57",
        [columns([[1, 0, 0], [0, 1, 5]]), columns([[1, 2, 3]])],
        [(QUARTER_TURN, np.array([100.0, 0, 0])), (np.array([1.0, 0, 0, 0]), np.zeros(3))],
    )
    with open_e57(path) as scan:
        assert scan.info.num_points == 3
        assert scan.info.sensor_position is None
        for size in (1, 2, 10):
            chunks = list(scan.chunks(size))
            xyz = np.concatenate([chunk.xyz for chunk in chunks])
            np.testing.assert_allclose(xyz, [[100, 1, 0], [99, 0, 5], [1, 2, 3]], atol=1e-12)
            index = np.concatenate([chunk.attributes["scan_index"] for chunk in chunks])
            assert index.tolist() == [0, 0, 1]


def test_points_of_many_bytes_come_in_smaller_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_scans(tmp_path / "one.e57", [columns([[1, 0, 0], [0, 1, 5], [1, 2, 3]])])
    monkeypatch.setattr(base, "CHUNK_BYTES", 24)  # two points of three float32
    with open_e57(path) as scan:
        assert [len(chunk) for chunk in scan.chunks()] == [2, 1]


def test_one_scan_knows_where_the_sensor_stood(tmp_path: Path) -> None:
    path = write_scans(
        tmp_path / "one.e57", [columns([[1, 2, 3]])], [(QUARTER_TURN, np.array([7.0, 8, 9]))]
    )
    with open_e57(path) as scan:
        assert scan.info.sensor_position is not None
        assert scan.info.sensor_position.tolist() == [7, 8, 9]


def test_attributes_and_invalid_points(tmp_path: Path) -> None:
    coloured = columns(
        [[1, 2, 3], [4, 5, 6]],
        intensity=np.array([0.25, 0.5], dtype=np.float32),
        colorRed=np.array([1, 255], dtype=np.uint8),
        colorGreen=np.array([2, 0], dtype=np.uint8),
        colorBlue=np.array([3, 9], dtype=np.uint8),
        rowIndex=np.array([0, 300], dtype=np.uint16),
        columnIndex=np.array([5, 6], dtype=np.uint16),
        cartesianInvalidState=np.array([0, 2], dtype=np.int8),
    )
    path = write_scans(tmp_path / "full.e57", [coloured, columns([[7, 8, 9]])])
    with open_e57(path) as scan:
        points = scan.read()
        dtypes = {name: values.dtype for name, values in points.attributes.items()}
        assert dtypes == dict(scan.info.attributes)
    assert points.attributes["red"].tolist() == [1, 255, 0]  # 0 in the scan that has no colour
    assert dtypes["red"] == np.uint8
    assert points.attributes["intensity"].tolist() == [0.25, 0.5, 0]
    assert dtypes["intensity"] == np.float32
    assert points.attributes["rowIndex"].tolist() == [0, 300, 0]
    assert points.xyz[[0, 2]].tolist() == [[1, 2, 3], [7, 8, 9]]
    assert np.isnan(points.xyz[1]).all()


def test_spherical_coordinates(tmp_path: Path) -> None:
    libe57 = pye57.libe57
    path = tmp_path / "spherical.e57"
    file = pye57.E57(str(path), mode="w")
    image = file.image_file
    prototype = libe57.StructureNode(image)
    names = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
    for name in names:
        prototype.set(name, libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE, -10.0, 10.0))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan = libe57.StructureNode(image)
    scan.set("points", points)
    file.data3d.append(scan)
    values = [np.array([2.0, 2.0]), np.array([np.pi / 2, 0]), np.array([0, np.pi / 6])]
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in zip(names, values, strict=True):
        buffers.append(libe57.SourceDestBuffer(image, name, column, 2, True, True))
    writer = points.writer(buffers)
    writer.write(2)
    writer.close()
    file.close()
    with open_e57(path) as reader:
        xyz = reader.read().xyz
        assert reader.info.sensor_position is None  # the file states no pose
    np.testing.assert_allclose(xyz, [[0, 2, 0], [np.sqrt(3), 0, 1]], atol=1e-12)


def test_refuses_damage_and_emptiness(tmp_path: Path) -> None:
    path = write_scans(tmp_path / "a.e57", [columns([[1, 2, 3]] * 500)])
    whole = path.read_bytes()
    path.write_bytes(whole[:-1024])
    with pytest.raises(ReadError, match="damaged E57"):
        open_e57(path)
    damaged = bytearray(whole)
    damaged[100] ^= 1  # in the first page, whose checksum no longer fits
    path.write_bytes(damaged)
    with pytest.raises(ReadError, match="damaged E57"), open_e57(path) as scan:
        scan.read()
    with pytest.raises(ReadError, match="no scans"):
        open_e57(write_scans(tmp_path / "none.e57", []))


def test_says_how_to_install_pye57(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pye57", None)
    with pytest.raises(ReadError, match=r'pip install "bushseg\[e57\]"'):
        open_e57(tmp_path / "a.e57")


def test_the_header_s_count_is_held_against_the_file(tmp_path: Path) -> None:
    colors = ("colorRed", "colorGreen", "colorBlue")
    path = write_scans(
        tmp_path / "one.e57",
        [columns([[1, 0, 0], [0, 1, 5]], **dict.fromkeys(colors, np.array([0, 255], np.uint8)))],
    )
    with e57.E57Reader(path) as scan:
        (header,) = scan._scans
        assert header.point_bits == 3 * 32 + 3 * 8
        most = 8 * path.stat().st_size // header.point_bits
        e57._check_counts(path, [dataclasses.replace(header, count=most)])
        for count, bits in ((most + 1, header.point_bits), (2**60, 0)):
            lying = dataclasses.replace(header, count=count, point_bits=bits)
            with pytest.raises(ReadError, match=f"{count:,} points in its header"):
                e57._check_counts(path, [lying])
