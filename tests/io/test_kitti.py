import struct
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import ReadError
from bushseg.io.kitti import open_kitti

FRAME = struct.pack("<12f", 1, 2, 3, 0.5, 0, 0, 0, 0, -4, 5, 6, 0.25)


def test_keeps_no_returns_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "frame.bin"
    path.write_bytes(FRAME)
    scan = open_kitti(path)
    points = scan.read()
    assert points.xyz.tolist() == [[1, 2, 3], [0, 0, 0], [-4, 5, 6]]
    assert points.attributes["intensity"].tolist() == [0.5, 0, 0.25]
    assert points.attributes["intensity"].dtype == np.float32
    assert scan.info.no_returns_at_origin
    assert scan.info.label_attribute is None
    assert scan.info.sensor_position is not None
    assert scan.info.sensor_position.tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("frames", "labels"),
    [
        (".", "."),
        ("velodyne", "labels"),
        ("os1_cloud_node_kitti_bin", "os1_cloud_node_semantickitti_label_id"),
    ],
)
def test_finds_labels(tmp_path: Path, frames: str, labels: str) -> None:
    (tmp_path / frames).mkdir(exist_ok=True)
    (tmp_path / labels).mkdir(exist_ok=True)
    path = tmp_path / frames / "000000.bin"
    path.write_bytes(FRAME)
    (tmp_path / labels / "000000.label").write_bytes(struct.pack("<3I", 19, 0, 7 << 16 | 3))
    scan = open_kitti(path)
    assert scan.info.label_attribute == "label"
    for size in (1, 2, 3):
        chunks = list(scan.chunks(size))
        assert np.concatenate([c.attributes["label"] for c in chunks]).tolist() == [19, 0, 3]
        assert np.concatenate([c.attributes["instance"] for c in chunks]).tolist() == [0, 0, 7]


def test_no_instances_no_column(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(FRAME)
    (tmp_path / "a.label").write_bytes(struct.pack("<3I", 1, 2, 65535))
    points = open_kitti(tmp_path / "a.bin").read()
    assert set(points.attributes) == {"intensity", "label"}
    assert points.attributes["label"].tolist() == [1, 2, 65535]


@pytest.mark.parametrize(
    ("labels", "message"), [(bytes(8), "2 labels"), (bytes(11), "multiple of 4"), (b"", "empty")]
)
def test_refuses_labels_that_do_not_fit(tmp_path: Path, labels: bytes, message: str) -> None:
    (tmp_path / "a.bin").write_bytes(FRAME)
    (tmp_path / "a.label").write_bytes(labels)
    with pytest.raises(ReadError, match=message):
        open_kitti(tmp_path / "a.bin")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (FRAME[:-1], "multiple of 16"),
        (bytes(32), "nothing but zeros"),
        (struct.pack("<8I", *range(1, 9)), "not finite"),  # integers, as floats: 1e-44
        (b"1.25 -3.5 0.75 1" * 4, "not finite"),
        (struct.pack("<4f", float("nan"), float("inf"), 1, 0), "not finite"),
        (np.random.default_rng(0).bytes(1600), "not finite"),
    ],
)
def test_refuses_what_is_not_coordinates(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(content)
    with pytest.raises(ReadError, match=message):
        open_kitti(path)
