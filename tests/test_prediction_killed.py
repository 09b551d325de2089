"""Predict that is killed at any moment: the same command goes on, and comes to the same bytes."""

import signal
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")

LOCK = ".*.bushseg/.lock"
TILES = ".*.bushseg/*/tile_"

NOTE_TILES = """
from bushseg.tile_labels import TileLabels
save = TileLabels.save
def save_and_note(self, path):
    save(self, path)
    with open({log!r}, "a") as file:
        file.write(path.name + "\\n")
TileLabels.save = save_and_note
"""
SPILL = """
from bushseg import tiled_scan
read_voxels = tiled_scan.read_voxels
def spill(*arguments, **options):
    return read_voxels(*arguments, **(options | {"max_voxels": 500}))
tiled_scan.read_voxels = spill
"""


@pytest.fixture(scope="module")
def scan(new_scene, write_las, tmp_path_factory) -> Path:
    """Of some ten tiles."""
    return write_las(tmp_path_factory.mktemp("scan") / "scan.las", new_scene(9, 30_000))


def kill_until_done(start, folder: Path, seconds: float, seed: int, most: int) -> int:
    """Start, kill, start again; says how often it was killed.

    Every other time it is killed at any moment at all, else soon after it has kept another tile:
    most of a short command's time is its start.

    Args:
        start: Starts the command.
        folder: Where its output and its lock go.
        seconds: What the whole command takes.
        seed: Of the moments.
        most: How often it is killed at most.
    """
    rng = np.random.default_rng(seed)
    for killed in range(most):
        command = start()
        command.wait_for(folder, LOCK)
        if killed % 2:
            time.sleep(rng.uniform(0, seconds))
        else:
            number = len(list(folder.glob(f"{TILES}*")))
            command.wait_for(folder, f"{TILES}{number:06d}.safetensors")
            time.sleep(rng.uniform(0, seconds / 20))
        command.kill()
        if is_done(command):
            return killed
    assert is_done(start())
    return most


def is_done(command) -> bool:
    """Whether a command has done its work, or found it done: killed as it ended, it had."""
    status, said = command.wait(), command.said.read_text()
    assert status in (0, -9) or (status == 1 and "exists already" in said), said
    return status != -9


def check_killed(start_command, scan, run, tmp_path, before: str, seed: int, most: int) -> int:
    common = ("predict", scan, "-m", run, "--tile-points", 1000, "--halo", 16, "-q", "-o")
    whole, killed = tmp_path / "whole" / "out.laz", tmp_path / "killed" / "out.laz"
    log = tmp_path / "tiles.log"
    command = start_command(*common, whole, before=before)
    command.wait_for(whole.parent, LOCK)
    begun = time.perf_counter()
    assert command.wait() == 0, command.said.read_text()
    seconds = time.perf_counter() - begun

    def start():
        return start_command(*common, killed, before=before + NOTE_TILES.format(log=str(log)))

    times = kill_until_done(start, killed.parent, seconds, seed, most)
    assert times >= 1
    assert killed.read_bytes() == whole.read_bytes()
    assert [path.name for path in killed.parent.iterdir()] == ["out.laz"]
    done = Counter(log.read_text().split())
    assert len(done) >= 5
    assert set(done.values()) == {1}  # no finished tile twice
    return times


@pytest.mark.parametrize("before", ["", SPILL], ids=["in memory", "on disk"])
def test_killed_at_random_moments(start_command, scan, run, tmp_path, before):
    check_killed(start_command, scan, run, tmp_path, before, seed=5, most=3)


@pytest.mark.slow
@pytest.mark.parametrize("before", ["", SPILL], ids=["in memory", "on disk"])
def test_killed_at_many_moments(start_command, scan, run, tmp_path, before):
    times = 0
    for seed in range(100):
        folder = tmp_path / str(seed)
        folder.mkdir()
        times += check_killed(start_command, scan, run, folder, before, seed, most=5)
        if times >= 40:
            return
    raise AssertionError(f"killed only {times} times")


def test_a_folder_killed_goes_on_with_the_scan_it_was_at(start_command, scan, run, tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    for name in ("a.las", "b.las"):
        (scans / name).write_bytes(scan.read_bytes())
    common = ("predict", scans, "-m", run, "--tile-points", 1000, "--halo", 16, "-o")
    killed = tmp_path / "killed"
    command = start_command(*common, killed)
    command.wait_for(killed, ".b*.bushseg/*/tile_000001*")
    command.kill()
    assert command.wait() == -9
    first = (killed / "a.las").stat().st_mtime_ns
    log = tmp_path / "tiles.log"
    command = start_command(*common, killed, before=NOTE_TILES.format(log=str(log)))
    assert command.wait() == 0
    assert "1 of 2 scans labelled" in command.said.read_text()
    assert "1 done before" in command.said.read_text()
    assert (killed / "a.las").stat().st_mtime_ns == first
    assert not {"tile_000000.safetensors", "tile_000001.safetensors"} & set(log.read_text().split())
    assert (killed / "b.las").read_bytes() == (killed / "a.las").read_bytes()
    assert sorted(path.name for path in killed.iterdir()) == [".bushseg.json", "a.las", "b.las"]


def test_a_folder_killed_while_others_label_its_scans(start_command, scan, run, tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    for number in range(4):
        (scans / f"{number}.las").write_bytes(scan.read_bytes())
    common = ("predict", scans, "-m", run, "--tile-points", 1000, "--halo", 16, "-o")
    killed = tmp_path / "killed"
    command = start_command(*common, killed, "--workers", 2)
    command.wait_for(killed, "[!.]*.las")
    command.kill()
    assert command.wait() == -9
    stood = {path.name: path.stat().st_mtime_ns for path in killed.glob("[!.]*.las")}
    # The processes it had end with it: their locks are free at once, or soon.
    for lock in killed.glob(LOCK):
        deadline = time.monotonic() + 30
        while lock.exists() and time.monotonic() < deadline and not is_free(lock):
            time.sleep(0.05)
    command = start_command(*common, killed, "--workers", 2)
    assert command.wait() == 0, command.said.read_text()
    stood_before = f"{len(stood)} done before"
    assert stood_before in command.said.read_text()
    now = {path.name: path.stat().st_mtime_ns for path in killed.glob("[!.]*.las")}
    assert {name: now[name] for name in stood} == stood
    assert len({(killed / name).read_bytes() for name in now}) == 1
    assert sorted(path.name for path in killed.iterdir()) == [".bushseg.json", *sorted(now)]
    assert len(now) == 4


def is_free(lock: Path) -> bool:
    """Whether nobody holds a lock."""
    import fcntl

    try:
        with lock.open() as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return True


def test_ctrl_c_says_that_the_same_command_goes_on(start_command, scan, run, tmp_path):
    common = ("predict", scan, "-m", run, "--tile-points", 1000, "--halo", 16, "-q", "-o")
    output = tmp_path / "out" / "out.las"
    for number in range(2):
        command = start_command(*common, output)
        command.wait_for(output.parent, f".*.bushseg/*/tile_00000{number}*")
        command.send(signal.SIGINT)
        if number:  # and once more, while it tidies up
            command.send(signal.SIGINT)
        assert command.wait() == 130
        assert command.said.read_text() == (
            "interrupted; what is done is kept, and the same command goes on from there\n"
        )
        assert list(output.parent.glob(f".*.bushseg/*/tile_00000{number}.safetensors"))
    assert start_command(*common, output).wait() == 0
    assert [path.name for path in output.parent.iterdir()] == ["out.las"]


# Killed as soon as the output stands.
TIDY = """
import os, signal
from bushseg import workspace
workspace._remove = lambda path: os.kill(os.getpid(), signal.SIGKILL)
"""


def test_killed_when_the_output_stood_the_same_command_says_so(start_command, scan, run, tmp_path):
    output = tmp_path / "out" / "out.las"
    common = ("predict", scan, "-m", run, "-o", output)
    assert start_command(*common, before=TIDY).wait() == -9
    assert len(list(output.parent.iterdir())) == 2
    stood = output.stat().st_mtime_ns
    command = start_command(*common)
    assert command.wait() == 0
    assert f"{output}: was finished by the run before" in command.said.read_text()
    assert f"{output}: 30,000 points in " in command.said.read_text()
    assert list(output.parent.iterdir()) == [output]
    assert output.stat().st_mtime_ns == stood
    # What stands since another command made it doesn't count as done.
    output.unlink()
    assert start_command(*common, before=TIDY).wait() == -9
    command = start_command(*common, "--keep-classification")
    assert command.wait() == 1
    assert "exists already" in command.said.read_text()
    assert list(output.parent.iterdir()) == [output]


def test_two_at_once(start_command, scan, run, tmp_path):
    common = ("predict", scan, "-m", run, "--tile-points", 1000, "-q", "-o", tmp_path / "out.las")
    first = start_command(*common)
    first.wait_for(tmp_path, ".*.bushseg/*/tile_000000*")
    first.send(signal.SIGSTOP)
    second = start_command(*common)
    assert second.wait() == 1
    assert second.said.read_text().count("\n") == 1
    assert "is at work here; wait until it has ended" in second.said.read_text()
    first.send(signal.SIGCONT)
    assert first.wait() == 0
