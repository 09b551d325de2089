"""Arrays in memory and in files are alike."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from bushseg import scratch
from bushseg.errors import CacheError, WriteError
from bushseg.scratch import Scratch, blocks


@pytest.mark.parametrize("folder", [None, "new/folder"])
def test_what_is_written_stays_when_pages_are_let_go(folder: str | None, tmp_path: Path) -> None:
    made = Scratch(folder and tmp_path / folder)
    first = made.empty("a", (1000, 3), np.float64)
    second = made.empty("b", (0, 2), np.int16)
    first[:] = np.arange(3000).reshape(1000, 3)
    made.release()
    assert first.sum() == 2999 * 3000 / 2
    assert (second.shape, second.dtype) == ((0, 2), np.int16)
    first[5] = 7
    made.release()
    assert first[5].tolist() == [7, 7, 7]


def test_a_new_array_of_the_same_name_leaves_the_old_one_alone(tmp_path: Path) -> None:
    made = Scratch(tmp_path)
    old = made.empty("a", (4,), np.int32)
    old[:] = 3
    made.empty("a", (9,), np.int32)[:] = 5
    made.release()
    assert old.tolist() == [3] * 4


def test_arrays_are_found_again(tmp_path: Path) -> None:
    made = Scratch(tmp_path)
    made.empty("a", (4, 2), np.int32)[:] = 8
    made.sync()
    again = Scratch(tmp_path)
    assert again.open("a", (4, 2), np.int32).tolist() == [[8, 8]] * 4
    with pytest.raises(CacheError, match="32 bytes; expected 36"):
        again.open("a", (9,), np.int32)
    with pytest.raises(CacheError, match="can't be read"):
        again.open("b", (9,), np.int32)
    made.remove()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_met_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(scratch, "_allocate", refuse)
    with pytest.raises(WriteError, match=r"no room for 8\.0 GB.*free some space"):
        Scratch(tmp_path).empty("a", (10**9,), np.float64)


@pytest.mark.parametrize(("size", "wanted"), [(0, 5), (3, 5), (10, 5), (1000, 10), (1003, 100)])
def test_samples_and_blocks(size: int, wanted: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch, "BLOCK_ROWS", 7)
    column = np.arange(size)
    sample = Scratch().sample(column, wanted)
    np.testing.assert_array_equal(sample, column[:: max(1, size // wanted)])
    parts = [column[rows] for rows in blocks(size)]
    assert all(len(part) <= 7 for part in parts)
    np.testing.assert_array_equal(np.concatenate([column[:0], *parts]), column)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such limit")
def test_more_arrays_than_a_process_may_keep_files_open(tmp_path: Path) -> None:
    import resource

    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    in_use = len(list(Path("/dev/fd").iterdir()))
    made = Scratch(tmp_path)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (in_use + 150, limits[1]))
        arrays = [made.empty(str(number), (1,), np.int64) for number in range(300)]
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    for number, array in enumerate(arrays):
        array[0] = number
    made.release()
    assert [int(array[0]) for array in arrays] == list(range(300))
