"""One process at a time in a folder; a process that dies leaves no lock."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from bushseg.errors import WriteError
from bushseg.locks import LOCK, locked

HOLD = """
import sys, time
from bushseg.locks import locked
with locked(sys.argv[1]):
    print("held", flush=True)
    time.sleep(60)
"""


def take(folder: Path) -> None:
    with locked(folder):
        pass


def test_the_lock_file_goes_with_the_lock(tmp_path: Path) -> None:
    with locked(tmp_path):
        assert (tmp_path / LOCK).read_text().startswith(f"{os.getpid()} on ")
    assert not list(tmp_path.iterdir())


def test_a_folder_is_made_and_stays_if_something_is_put_into_it(tmp_path: Path) -> None:
    take(tmp_path / "a" / "b")
    assert [path.name for path in tmp_path.rglob("*")] == ["a"]
    with locked(tmp_path / "a" / "b"):
        (tmp_path / "a" / "b" / "result").touch()
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["result"]


def test_a_second_one_is_told_who_is_first(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(WriteError, match=rf"\({os.getpid()} on .*at work here"):
        take(tmp_path)
    take(tmp_path)


def test_another_folder_or_name_is_another_lock(tmp_path: Path) -> None:
    with locked(tmp_path), locked(tmp_path / "below"), locked(tmp_path, ".other.lock"):
        pass


def test_an_error_inside_gives_the_folder_free(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="inside"), locked(tmp_path):
        raise ValueError("inside")
    take(tmp_path)


def test_a_lock_file_that_was_left_locks_nothing(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_text("12345 on a machine long gone")
    take(tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_a_killed_process_holds_nothing(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(WriteError, match=rf"\({process.pid} on "):
            take(tmp_path)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        take(tmp_path)
    finally:
        process.kill()


def test_who_is_patient_has_it_next(tmp_path: Path) -> None:
    held, order = threading.Event(), []

    def hold() -> None:
        with locked(tmp_path):
            held.set()
            refused.wait(30)
            order.append("first")

    refused = threading.Event()
    thread = threading.Thread(target=hold)
    thread.start()
    assert held.wait(30)
    with pytest.raises(WriteError):
        take(tmp_path)
    refused.set()
    with locked(tmp_path, patience=30):
        order.append("second")
    thread.join()
    assert order == ["first", "second"]
    assert not list(tmp_path.iterdir())


def test_never_two_at_once(tmp_path: Path) -> None:
    """Threads take and give back one lock as fast as they can: the removed file fools nobody."""
    inside, most, taken = 0, 0, 0

    def work() -> None:
        nonlocal inside, most, taken
        for _ in range(200):
            try:
                with locked(tmp_path):
                    inside += 1
                    most = max(most, inside)
                    taken += 1
                    inside -= 1
            except WriteError:
                continue

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    assert taken > 0


def test_a_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(WriteError, match="can't write here"):
        take(tmp_path / "file")
