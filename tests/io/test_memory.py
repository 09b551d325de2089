"""Points in memory, read as a file would be."""

import numpy as np
import pytest

from bushseg.io.memory import MemoryReader
from bushseg.points import PointCloud

CLOUD = PointCloud(
    np.arange(21, dtype=np.float64).reshape(7, 3),
    {"red": np.arange(7, dtype=np.uint16), "echo": np.arange(14).reshape(7, 2)},
)


def test_the_header_tells_what_is_there() -> None:
    info = MemoryReader(CLOUD, (1, 2, 3)).info
    assert info.num_points == 7
    assert info.attributes == {"red": np.dtype(np.uint16), "echo": np.dtype((np.int64, 2))}
    assert info.sensor_position is not None
    assert info.sensor_position.tolist() == [1, 2, 3]
    assert MemoryReader(CLOUD).info.sensor_position is None


@pytest.mark.parametrize("size", [1, 3, 7, 100])
def test_chunks_hold_all_points_in_order(size: int) -> None:
    reader = MemoryReader(CLOUD)
    for _ in range(2):  # each call starts anew
        chunks = list(reader.chunks(size))
        assert [len(chunk) for chunk in chunks[:-1]] == [size] * (len(chunks) - 1)
        np.testing.assert_array_equal(np.concatenate([chunk.xyz for chunk in chunks]), CLOUD.xyz)
        for name, column in CLOUD.attributes.items():
            parts = [chunk.attributes[name] for chunk in chunks]
            np.testing.assert_array_equal(np.concatenate(parts), column)


def test_nothing_is_copied() -> None:
    (chunk,) = MemoryReader(CLOUD).chunks()
    assert np.shares_memory(chunk.xyz, CLOUD.xyz)
    assert np.shares_memory(chunk.attributes["echo"], CLOUD.attributes["echo"])


def test_no_points_are_read_as_none() -> None:
    empty = PointCloud(np.empty((0, 3)), {"red": np.empty(0, np.uint16)})
    with MemoryReader(empty) as reader:
        assert len(reader.read()) == 0
        assert list(reader.read().attributes) == ["red"]
