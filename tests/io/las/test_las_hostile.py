"""Files that lie: a ReadError or the points the header declares, nothing else."""

import io
import math
import struct
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.errors import ReadError
from bushseg.io import laz
from bushseg.io.las import open_las
from bushseg.io.las_header import VariableRecord
from bushseg.io.laz_body import lazrs_errors

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")


def read_all(path: Path) -> int:
    """Read every point; the number of points read."""
    with open_las(path) as reader:
        count = sum(len(chunk) for chunk in reader.chunks(64))
        assert count == reader.info.num_points > 0
        return count


HEADER_LIES = [
    # where, layout, values, what the message says
    (0, "4s", [b"LASX"], "begins with"),
    (24, "BB", [2, 0], "LAS 2.0"),
    (24, "BB", [1, 9], "LAS 1.9"),
    (94, "H", [100], "header of 100 bytes"),
    (94, "H", [65535], "header of 65535 bytes"),
    (96, "I", [10], "points at byte 10"),
    (96, "I", [0xFFFFFFFF], "points at byte 4,294,967,295"),
    (100, "I", [0xFFFFFFFF], "4,294,967,295 VLRs"),
    (100, "I", [40], "VLR"),
    (104, "B", [11], "point format 11"),
    (104, "B", [0x40], "point format 64"),
    (105, "H", [5], "5 bytes a point"),
    (131, "d", [0.0], "scales"),
    (139, "d", [math.nan], "scales"),
    (147, "d", [1e300], "scales"),
    (147, "d", [math.inf], "scales"),
    (155, "d", [math.inf], "offsets"),
    (247, "Q", [2**60], "1,152,921,504,606,846,976"),
    (247, "Q", [101], "101"),
    (235, "QI", [0, 0xFFFFFFFF], "4,294,967,295 EVLRs"),
    (235, "QI", [2**63, 1], "EVLRs"),
]


@pytest.mark.parametrize(("at", "layout", "values", "found"), HEADER_LIES)
def test_a_header_that_lies_is_refused(make_las, patch_file, at, layout, values, found):
    path = make_las("a.las", evlrs=True)
    patch_file(path, at, layout, *values)
    with pytest.raises(ReadError, match=found):
        read_all(path)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("version", ["1.2", "1.4"])
def test_no_points_is_not_a_scan(make_las, version, suffix):
    path = make_las("a" + suffix, version=version, point_format=3, count=0)
    with pytest.raises(ReadError, match="holds no points"):
        open_las(path)


def test_a_file_cut_at_a_record_is_refused(make_las):
    path = make_las("a.las", version="1.2", point_format=0)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ReadError, match=r"room for 99 points; expected the 100"):
        open_las(path)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_file_cut_anywhere_is_refused(make_las, suffix):
    path = make_las("a" + suffix, evlrs=True)
    whole = path.read_bytes()
    for size in [*range(1, len(whole), 997), len(whole) - 1]:
        path.write_bytes(whole[:size])
        with pytest.raises(ReadError):
            read_all(path)


def test_points_may_not_run_into_evlrs(make_las, patch_file):
    path = make_las("a.las", evlrs=True)
    patch_file(path, 247, "Q", 102)
    with pytest.raises(ReadError, match="room for 100 points"):
        open_las(path)


def test_mislabelled_files_are_named(tmp_path):
    path = tmp_path / "a.laz"
    path.write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    with pytest.raises(ReadError, match="Git-LFS pointer"):
        open_las(path)
    path.write_bytes(b"LASF")
    with pytest.raises(ReadError, match="4 bytes; expected a LAS header"):
        open_las(path)


def laszip_vlr_at(raw: bytes) -> int:
    return raw.index(b"laszip encoded") - 2 + 54


LAZ_LIES = [
    # offset in the LASzip VLR, layout, values, what the message says
    (0, "H", [0], "compressor 0"),
    (0, "H", [1], "compressor 1"),
    (0, "H", [9], "compressor 9"),
    (2, "H", [1], "coder 1"),
    (12, "I", [1], "table of 1 LAZ chunks"),
    (12, "I", [0], "LAZ chunk"),
    (32, "H", [60000], "cut off before its 60000 items"),
    (32, "H", [1], r"items \(10,\)"),
    (34, "H", [99], r"items \(99, 11\)"),
    (36, "H", [31], "37 bytes"),
    (38, "H", [77], "don't decode"),
]


@pytest.mark.parametrize(("at", "layout", "values", "found"), LAZ_LIES)
def test_a_laszip_vlr_that_lies_is_refused(make_las, patch_file, at, layout, values, found):
    path = make_las("a.laz")
    patch_file(path, laszip_vlr_at(path.read_bytes()) + at, layout, *values)
    with pytest.raises(ReadError, match=found):
        read_all(path)


def test_a_chunk_table_that_would_exhaust_memory_is_refused(make_las, patch_file, parts):
    path = make_las("a.laz")
    (start,) = parts(path).get("I", 96)
    (table,) = parts(path).get("q", start)
    patch_file(path, table + 4, "I", 0xFFFFFFF0)
    with pytest.raises(ReadError, match="table of 4,294,967,280 LAZ chunks"):
        open_las(path)


def test_an_endless_point_count_in_laz_is_refused(make_las, patch_file):
    path = make_las("a.laz")
    patch_file(path, 247, "Q", 2**60)
    with pytest.raises(ReadError, match="table of 1 LAZ chunks; expected one for 1,152"):
        open_las(path)


@pytest.mark.parametrize("table", [-5, 0, 3, 2**62])
def test_a_chunk_table_outside_the_file_is_refused(make_las, patch_file, parts, table):
    path = make_las("a.laz")
    patch_file(path, parts(path).get("I", 96)[0], "q", table)
    with pytest.raises(ReadError, match="no LAZ chunk table"):
        open_las(path)


@pytest.mark.parametrize("streamed", [False, True])
def test_a_layer_that_would_exhaust_memory_is_refused(
    make_las, patch_file, parts, streamed, monkeypatch
):
    if streamed:
        monkeypatch.setattr(laz, "_MAX_CHUNK_BYTES", 1)
    path = make_las("a.laz", point_format=6)
    (start,) = parts(path).get("I", 96)
    patch_file(path, start + 8 + 30 + 4, "I", 0xFFFFFFF0)
    with open_las(path) as reader, pytest.raises(ReadError, match="parts don't fit"):
        reader.read()


def test_compressed_points_without_a_laszip_vlr_are_refused(make_las):
    path = make_las("a.laz")
    path.write_bytes(path.read_bytes().replace(b"laszip encoded", b"laszip obscure"))
    with pytest.raises(ReadError, match="without a LASzip VLR"):
        open_las(path)


def test_a_panic_is_told_from_an_interrupt():
    class PanicException(BaseException):
        pass

    with (
        pytest.raises(ReadError, match="a: left: 1 right: 2; expected b"),
        lazrs_errors(lambda text: ReadError("a", text, "b")),
    ):
        raise PanicException("left: 1\n  right: 2")
    with pytest.raises(KeyboardInterrupt), lazrs_errors(lambda text: ReadError("a", text, "")):
        raise KeyboardInterrupt


@pytest.mark.parametrize("point_format", [3, 7])
def test_large_chunks_are_streamed_to_the_same_points(make_las, point_format, monkeypatch):
    path = make_las("a.laz", point_format=point_format)
    with open_las(path) as reader:
        expected = reader.read().record
        monkeypatch.setattr(laz, "_MAX_CHUNK_BYTES", 1)
        streamed = np.concatenate([chunk.record for chunk in reader.chunks(9)])
    assert streamed.tobytes() == expected.tobytes()


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(["a.las", "a.laz"]),
    point_format=st.sampled_from([3, 7]),
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=4),
    keep=st.one_of(st.just(1.0), st.floats(0, 1)),
)
def test_any_damage_is_refused_or_harmless(small_files, name, point_format, flips, keep):
    raw = bytearray(small_files[name, point_format])
    for where, bits in flips:
        raw[int(where * len(raw))] ^= bits
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(raw[: max(1, int(keep * len(raw)))])
        with suppress(ReadError):
            read_all(path)


def test_the_file_that_allocates_9_gb_is_refused(scans):
    path = scans / "edge" / "laspy" / "tests__allocates_9GB.laz"
    if not path.exists():
        pytest.skip(f"no {path}")
    with pytest.raises(ReadError, match="563,518,713 LAZ chunks"):
        open_las(path)


def test_no_more_of_a_record_is_read_than_asked_for():
    record = VariableRecord(b"", "LASF_Spec", 4, offset=2, length=5)
    file = io.BytesIO(b"0123456789")
    assert [record.payload(file, limit) for limit in (None, 3, 9)] == [b"23456", b"234", b"23456"]


def test_struct_sizes_are_the_specifications():
    from bushseg.io import las_header

    assert struct.calcsize("<H16sHH32s") == las_header.VLR_HEAD.size == 54
    assert las_header.EVLR_HEAD.size == 60
    assert las_header.HEADER_1_0.size == 227
    assert las_header.HEADER_1_4_AT + las_header.HEADER_1_4.size == 375
