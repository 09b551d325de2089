"""Prepare that is killed at any moment: the same command goes on, and comes to the same files."""

import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import WriteError
from bushseg.locks import locked
from bushseg.preparation import prepare

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")


Written = tuple[int, int]
"""Which file it is and when it was written: reading changes other times."""


def finished(folder: Path) -> dict[Path, Written]:
    """The files of complete scans."""
    return {
        path: (path.stat().st_ino, path.stat().st_mtime_ns)
        for manifest in folder.glob("scans/*/manifest.json")
        for path in manifest.parent.glob("[!.]*")
    }


def kill_until_done(start, folder: Path, seconds: float, seed: int, most: int) -> int:
    """Start, kill at any moment, start again; says how often it was killed."""
    kept: dict[Path, Written] = {}
    for killed, share in enumerate(np.random.default_rng(seed).uniform(0, 1, most)):
        command = start()
        command.wait_for(folder, ".lock")
        time.sleep(share * seconds)
        command.kill()
        status = command.wait()
        assert status in (0, -9), command.said.read_text()
        now = finished(folder)
        assert kept.items() <= now.items()  # no finished scan is touched again
        kept = now
        if status == 0:
            return killed
    command = start()
    assert command.wait() == 0, command.said.read_text()
    assert kept.items() <= finished(folder).items()
    return most


ON_DISK = """
from bushseg import preparation, voxel_normals
preparation.MAX_VOXELS, voxel_normals._TILE_POINTS = 100, 700
"""
"""As if memory held a hundred voxels."""


def check_killed(
    start_command, scans, settings, tmp_path, contents, seed: int, most: int, before: str = ""
) -> int:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    common = ("prepare", scans, "-c", settings, "-q", "-o")

    def start():
        return start_command(*common, killed, before=before)

    command = start_command(*common, whole, before=before)
    command.wait_for(whole, ".lock")
    begun = time.perf_counter()
    assert command.wait() == 0, command.said.read_text()
    seconds = time.perf_counter() - begun
    times = kill_until_done(start, killed, seconds, seed, most)
    assert times >= 1
    assert contents(killed) == contents(whole)
    return times


@pytest.fixture
def settings(tiny, tmp_path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(tiny().to_toml())
    return path


@pytest.mark.parametrize("before", ["", ON_DISK], ids=["in memory", "on disk"])
def test_killed_at_random_moments(before, start_command, scans, settings, tmp_path, contents):
    check_killed(start_command, scans, settings, tmp_path, contents, seed=1, most=4, before=before)


def test_killed_while_other_processes_work(start_command, scans, settings, tmp_path, contents):
    common = ("prepare", scans, "-c", settings, "-q", "--workers", 2, "-o")
    command = start_command(*common, tmp_path / "killed")
    command.wait_for(tmp_path / "killed", "scans/*/tile_0000*")
    command.kill()
    assert command.wait() == -9
    command = start_command(*common, tmp_path / "killed")
    assert command.wait() == 0, command.said.read_text()
    command = start_command("prepare", scans, "-c", settings, "-q", "-o", tmp_path / "whole")
    assert command.wait() == 0, command.said.read_text()
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("before", ["", ON_DISK], ids=["in memory", "on disk"])
def test_killed_at_many_moments(before, start_command, scans, settings, tmp_path, contents):
    times = 0
    for seed in range(100):
        folder = tmp_path / str(seed)
        folder.mkdir()
        times += check_killed(
            start_command, scans, settings, folder, contents, seed, most=5, before=before
        )
        if times >= 40:
            return
    raise AssertionError(f"killed only {times} times")


def test_what_a_killed_run_left_is_removed(scans, tiny, tmp_path, contents):
    whole = prepare([scans], tmp_path / "whole", tiny().prepare).folder
    folder = prepare([scans], tmp_path / "killed", tiny().prepare).folder
    tile = next(folder.glob("scans/*/tile_0000*"))
    crop = next(folder.glob("crops-*/crop_00000*"))
    for finished_file in (tile, crop, folder / "dataset.json"):
        partial = f".{finished_file.stem}-abcd1234.partial{finished_file.suffix}"
        finished_file.with_name(partial).write_text("half")
    for path in (tile, crop):
        path.with_name("manifest.json").unlink()
    prepare([scans], folder, tiny().prepare)
    assert contents(folder) == contents(whole)


def test_ctrl_c_says_that_the_same_command_goes_on(start_command, scans, settings, tmp_path):
    common = ("prepare", scans, "-c", settings, "-q", "-o", tmp_path / "data")
    command = start_command(*common)
    command.wait_for(tmp_path / "data", "scans/*/manifest.json")
    command.send(signal.SIGINT)
    assert command.wait() == 130
    assert command.said.read_text().startswith("interrupted; what is done is kept")
    assert command.said.read_text().count("\n") == 1
    kept = finished(tmp_path / "data")
    assert kept
    assert start_command(*common).wait() == 0
    assert kept.items() <= finished(tmp_path / "data").items()
    assert not list((tmp_path / "data").rglob(".*"))


def test_two_at_once(scans, tiny, tmp_path):
    with locked(tmp_path / "data"), pytest.raises(WriteError, match="at work here"):
        prepare([scans], tmp_path / "data", tiny().prepare)
