import struct
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import ReadError, WriteError
from bushseg.io.base import ScanReader
from bushseg.io.codes import create_label, create_labels, read_codes
from bushseg.io.memory import MemoryReader
from bushseg.points import PointCloud

POINTS = PointCloud(np.zeros((3, 3)))


@pytest.fixture
def source(tmp_path: Path) -> ScanReader:
    return MemoryReader(POINTS)


def test_label(tmp_path: Path, source: ScanReader) -> None:
    path = tmp_path / "a.label"
    with create_label(path, source, {}) as writer:
        for part in (slice(2), slice(2, 3)):
            chunk = PointCloud(POINTS.xyz[part])
            writer.write(chunk, {"p": np.zeros(len(chunk))}, np.array([0, 19, 65535])[part])
    assert path.read_bytes() == struct.pack("<3I", 0, 19, 65535)
    assert read_codes(path).tolist() == [0, 19, 65535]


def test_labels(tmp_path: Path, source: ScanReader) -> None:
    path = tmp_path / "a.labels"
    with create_labels(path, source, {}) as writer:
        writer.write(POINTS, {}, np.array([8, -1, 0], dtype=np.int8))
    assert path.read_bytes() == b"8\n-1\n0\n"
    assert read_codes(path).tolist() == [8, -1, 0]
    assert read_codes(path).dtype == np.int32


def test_instances_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.label"
    path.write_bytes(struct.pack("<2I", 5 << 16 | 3, 4))
    assert read_codes(path).tolist() == [3, 4]


@pytest.mark.parametrize(("code", "message"), [(-1, "-1 to 0"), (65536, "0 to 65536")])
def test_label_refuses_codes_it_cannot_hold(
    tmp_path: Path, source: ScanReader, code: int, message: str
) -> None:
    writer = create_label(tmp_path / "a.label", source, {})
    with pytest.raises(WriteError, match=message):
        writer.write(POINTS, {}, np.array([0, code, 0]))


@pytest.mark.parametrize("create", [create_label, create_labels])
def test_needs_codes_for_every_point(tmp_path: Path, source: ScanReader, create) -> None:
    writer = create(tmp_path / "a", source, {})
    with pytest.raises(WriteError, match="no class codes"):
        writer.write(POINTS, {}, None)
    with pytest.raises(WriteError, match="incomplete"):
        writer.close()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.label", b"abc", "multiple of 4"),
        ("a.labels", b"# none\n", "no codes"),
        ("a.labels", b"1\n2.5\n", "line 2"),
        ("a.labels", b"", "empty"),
        ("a.npy", b"1\n", "suffix"),
    ],
)
def test_refuses_damage(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ReadError, match=message):
        read_codes(path)
