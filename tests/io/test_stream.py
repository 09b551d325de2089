from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import WriteError
from bushseg.io import base, stream
from bushseg.io.memory import MemoryReader
from bushseg.io.text import create_txt
from bushseg.points import PointCloud


def test_read_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "records"
    path.write_bytes(b"head" + np.arange(10, dtype="<u2").tobytes() + b"tail")

    body = stream.Body(path, 4, 1, np.dtype("<u2"))

    def read(count: int, size: int) -> list[list[int]]:
        return [part.tolist() for part in stream.read_records(body, size, count)]

    assert read(3, 10) == [[0, 1, 2]]
    assert read(5, 2) == [[0, 1], [2, 3], [4]]
    monkeypatch.setattr(base, "CHUNK_BYTES", 6)
    assert read(5, 100) == [[0, 1, 2], [3, 4]]
    monkeypatch.setattr(base, "CHUNK_BYTES", 1)  # narrower than a record
    assert read(2, 100) == [[0], [1]]


def test_a_file_that_ends_early_gives_what_there_is(tmp_path: Path) -> None:
    path = tmp_path / "records"
    path.write_bytes(bytes(5))
    body = stream.Body(path, 0, 1, np.dtype("<u2"))
    assert sum(map(len, stream.read_records(body, 10, 100))) == 2


def test_writing_starts_anew_and_says_what_the_disk_refused(tmp_path: Path) -> None:
    points = PointCloud(np.ones((1, 3)))
    path = tmp_path / "out.txt"
    path.write_bytes(b"what stood here before")
    with create_txt(path, MemoryReader(points), {}) as writer:
        writer.write(points, {}, None)
    assert path.read_bytes() == b"# x y z\n1.0 1.0 1.0\n"
    writer = create_txt(tmp_path / "none" / "out.txt", MemoryReader(points), {})
    with pytest.raises(WriteError, match="No such file"):
        writer.write(points, {}, None)
