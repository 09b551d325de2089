"""lazrs in a process of its own: what it dies of is refused, and nothing of it stays behind."""

import gc
import io
import os
import signal
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import ReadError
from bushseg.io import laz_process, laz_worker
from bushseg.io.las import open_las
from bushseg.io.laz_process import LazProcess
from bushseg.io.laz_worker import Window


def children() -> set[int]:
    """Processes of ours that run or wait to be taken note of."""
    path = Path(f"/proc/self/task/{os.getpid()}/children")
    if not path.exists():
        pytest.skip("no list of child processes")
    return {int(number) for number in path.read_text().split()}


@pytest.mark.parametrize(("edition", "number"), [("1.2", 1), ("1.4", 6), ("1.4", 7)])
def test_bytes_that_kill_lazrs_do_not_kill_us(make_las, parts, edition, number):
    # Found by benchmarks/fuzz.py. Where lazrs survives them, they decode to points like any others.
    path = make_las("a.laz", version=edition, point_format=number)
    raw = bytearray(path.read_bytes())
    (start,), (length,) = parts(path).get("I", 96), parts(path).get("H", 105)
    (table,) = parts(path).get("q", start)
    body = start + 8 + length + (4 + 4 * 10 if number >= 6 else 0)
    for begin in (body, body + 40):
        damaged = raw[:begin] + b"\xff" * (table - begin) + raw[table:]
        path.write_bytes(damaged)
        with open_las(path) as reader, suppress(ReadError):
            assert len(reader.read()) == 100


def test_a_decoder_that_dies_is_one_line(tmp_path, monkeypatch):
    script = tmp_path / "worker.py"
    script.write_text("import os, sys\nsys.stdin.readline()\nos.kill(os.getpid(), 11)\n")
    monkeypatch.setattr(laz_process.laz_worker, "__file__", str(script))
    process = LazProcess(tmp_path / "a.laz")
    with pytest.raises(ReadError, match=r"the decoder died of it, SIGSEGV"):
        list(process.run({}, 9))


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        ("LENGTH.pack(10) + bytes(10)", "too long"),
        ("LENGTH.pack(2**62)", "too long"),
        ("LENGTH.pack(9) + bytes(8)", "exit status 0"),
        ("LENGTH.pack(-1) + LENGTH.pack(2) + b'\"\"'", r"don't decode \(\)"),
        ('LENGTH.pack(-1) + LENGTH.pack(10) + b\'["f", "e"]\'', "f; expected e"),
        ("b''", "exit status 0"),
    ],
)
def test_answers_are_not_believed(tmp_path, monkeypatch, answer, found):
    script = tmp_path / "worker.py"
    script.write_text(
        "import struct, sys\nLENGTH = struct.Struct('<q')\nsys.stdin.readline()\n"
        f"sys.stdout.buffer.write({answer})\n"
    )
    monkeypatch.setattr(laz_process.laz_worker, "__file__", str(script))
    with pytest.raises(ReadError, match=found):
        list(LazProcess(tmp_path / "a.laz").run({}, 9))


def test_one_process_serves_the_table_and_the_points(make_las):
    before = children()
    with open_las(make_las("a.laz")) as reader:
        (process,) = children() - before
        reader.read()
        assert children() - before == {process}
        others = [reader.chunks(10), reader.chunks(10)]
        for chunks in others:
            next(chunks)
        assert len(children() - before) == 2
        del chunks, others
        gc.collect()
        reader.read()
    assert children() == before


@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
def test_a_reader_left_open_or_killed_leaves_nothing(make_las):
    before = children()
    reader = open_las(make_las("a.laz"))
    (process,) = children() - before
    os.kill(process, signal.SIGKILL)
    with pytest.raises(ReadError, match="SIGKILL"):
        reader.read()
    assert len(reader.read()) == 100  # by another one
    del reader
    gc.collect()
    assert children() == before


def test_a_refused_file_leaves_nothing(make_las, patch_file, parts):
    before = children()
    path = make_las("a.laz")
    (table,) = parts(path).get("q", parts(path).get("I", 96)[0])
    patch_file(path, table + 8, "I", 0xFFFFFFFF)
    with pytest.raises(ReadError):
        open_las(path).read()
    gc.collect()
    assert children() == before


def test_without_lazrs_it_says_how_to_get_it(make_las, monkeypatch):
    path = make_las("a.laz")
    monkeypatch.setattr(laz_process, "find_spec", lambda _: None)
    with pytest.raises(ReadError, match="pip install lazrs"):
        open_las(path)


@pytest.mark.parametrize("size", [1, 3, 4, 100])
def test_a_window_is_a_file_of_its_own(size):
    file = io.BytesIO(b"0123456789")
    window = Window(file, 2, 5, b"ab", b"yz")
    data = b""
    while piece := window.read(size):
        data += piece
    assert data == b"ab23456yz"
    assert window.seek(-3, os.SEEK_END) == 6
    assert window.read() == b"6"
    assert window.read() == b"yz"
    assert window.seek(-99) == 0
    buffer = bytearray(9)
    assert window.readinto(buffer) == 2


def test_the_worker_in_words():
    lines = b'{"path": "no such file", "table": 0, "vlr": ""}\n{"path": ""}\nnonsense\n'
    said: list[bytes] = []
    laz_worker.serve(io.BytesIO(lines), lambda data: said.append(bytes(data)))
    assert len(said) == 3
    for text in said:
        assert np.frombuffer(text, "<i8", 1)[0] == -1
    assert b"No such file" in said[0]
