"""A scan kept from its first reading: the same chunks again, and never more than may be kept."""

import weakref
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bushseg.io.kept import KeptReader
from bushseg.io.memory import MemoryReader
from bushseg.points import PointCloud

CHUNK = 100  # points; 24 bytes of coordinates and 2 of intensity each


class Counted(MemoryReader):
    """Counts how often it is read from the start."""

    readings = 0

    def chunks(self, size: int = CHUNK) -> Iterator[PointCloud]:
        self.readings += 1
        for chunk in super().chunks(min(size, CHUNK)):
            yield PointCloud(chunk.xyz.copy(), chunk.attributes)


def make_reader(count: int) -> Counted:
    xyz = np.random.default_rng(0).random((count, 3))
    return Counted(PointCloud(xyz, {"intensity": np.arange(count, dtype=np.uint16)}))


def equal(first: list[PointCloud], second: list[PointCloud]) -> bool:
    return len(first) == len(second) and all(
        np.array_equal(a.xyz, b.xyz)
        and np.array_equal(a.attributes["intensity"], b.attributes["intensity"])
        for a, b in zip(first, second, strict=True)
    )


@pytest.mark.parametrize(("limit", "readings"), [(26 * 250, 1), (26 * 250 - 1, 2), (0, 2)])
def test_a_small_scan_is_read_once_and_a_large_one_twice(limit: int, readings: int) -> None:
    reader = make_reader(250)
    kept = KeptReader(reader, limit)
    assert kept.info is reader.info
    first, second = list(kept.chunks()), list(kept.chunks())
    assert reader.readings == readings
    assert [len(chunk) for chunk in first] == [100, 100, 50]
    assert equal(first, second)


def test_nothing_is_kept_of_a_scan_that_will_be_beyond_the_limit() -> None:
    kept = KeptReader(make_reader(1000), limit=26 * 300)
    assert [len(kept.held) for _ in kept.chunks()] == [0] * 10


def test_a_scan_that_turns_out_larger_than_it_said_is_let_go_of() -> None:
    reader = make_reader(1000)
    reader.info = replace(reader.info, num_points=250)
    kept = KeptReader(reader, limit=26 * 300)
    assert [len(kept.held) for _ in kept.chunks()] == [1, 2, 3, 0, 0, 0, 0, 0, 0, 0]


def test_a_reading_that_was_broken_off_is_not_kept() -> None:
    reader = make_reader(250)
    kept = KeptReader(reader)
    next(kept.chunks())
    assert sum(map(len, kept.chunks())) == 250
    assert sum(map(len, kept.chunks())) == 250
    assert reader.readings == 2


def test_records_count_too() -> None:
    class Recorded(Counted):
        def chunks(self, size: int = CHUNK) -> Iterator[PointCloud]:
            for chunk in super().chunks(size):
                yield PointCloud(chunk.xyz, chunk.attributes, np.zeros(len(chunk), "V20"))

    reader = Recorded(make_reader(100).read())
    for limit, readings in ((46 * 100, 1), (46 * 100 - 1, 2)):
        reader.readings = 0
        kept = KeptReader(reader, limit)
        list(kept.chunks())
        list(kept.chunks())
        assert reader.readings == readings


@pytest.mark.parametrize(("wanted", "got"), [(1, 100), (100, 100), (101, 200), (1000, 250)])
def test_what_is_read_ahead_is_not_read_again(wanted: int, got: int) -> None:
    reader = make_reader(250)
    kept = KeptReader(reader)
    ahead = kept.head(wanted)
    assert sum(map(len, ahead)) == got
    whole, again = list(kept.chunks()), list(kept.chunks())
    assert reader.readings == 1
    assert equal(whole, list(make_reader(250).chunks()))
    assert equal(whole, again)


def test_beyond_the_limit_only_the_second_pass_reads_again() -> None:
    reader = make_reader(250)
    kept = KeptReader(reader, limit=0)
    kept.head(1)
    assert sum(map(len, kept.chunks())) == sum(map(len, kept.chunks())) == 250
    assert reader.readings == 2


def test_what_was_read_ahead_may_be_forgotten() -> None:
    reader = make_reader(250)
    kept = KeptReader(reader)
    chunk = weakref.ref(kept.head(1)[0].xyz)
    assert chunk() is not None
    kept.forget_head()
    assert chunk() is None
    assert equal(list(kept.chunks()), list(make_reader(250).chunks()))
    assert reader.readings == 2
