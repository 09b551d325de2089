"""Training that is killed, or whose disk is full: what was saved stands, and goes on from there."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from bushseg.checkpoint import load_checkpoint
from bushseg.config import Config
from bushseg.errors import CheckpointError, WriteError
from bushseg.locks import locked
from bushseg.runs import LAST
from bushseg.training import train

FILES = ["best.safetensors", "config.toml", "curves.png", "last.safetensors", "metrics.csv"]
SCRIPT = Path(sys.executable).with_name("bushseg")

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")


def same_weights(one: Path, two: Path) -> bool:
    """Of both networks and both optimizers, bit by bit."""
    first, second = (load_checkpoint(run / LAST)[2] for run in (one, two))
    return first.keys() == second.keys() and all(
        torch.equal(first[name], second[name]) for name in first
    )


def kill_until_done(start, folder: Path, delays) -> int:
    """Start, kill after each delay, resume; says how many were killed before the run was done.

    Args:
        start: `start(resume)` starts a process that trains.
        folder: The run.
        delays: Seconds, counted from when the folder is locked.
    """
    killed = 0
    for delay in delays:
        process = start((folder / LAST).exists())
        while not (folder / ".lock").exists() and process.poll() is None:
            time.sleep(0.01)
        time.sleep(delay)
        process.kill()
        if process.wait() == 0:
            return killed
        assert process.returncode == -signal.SIGKILL
        killed += 1
        if (folder / LAST).exists():
            load_checkpoint(folder / LAST)  # raises if it is no intact file
    assert start((folder / LAST).exists()).wait() == 0
    return killed


class Forked:
    """`train` in a process that has imported everything already."""

    def __init__(self, *arguments, **options) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["bushseg.training"])
        self._process = context.Process(target=train, args=arguments, kwargs=options)
        self._process.start()

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def poll(self) -> int | None:
        return self._process.exitcode

    def kill(self) -> None:
        self._process.kill()

    def wait(self) -> int | None:
        self._process.join()
        return self._process.exitcode


@pytest.fixture
def config(tiny) -> Config:
    """Three epochs of eight steps, saved after each of these."""
    return tiny(epochs=3, steps_per_epoch=8, validation="scan:south", checkpoint_minutes=0)


def test_killed_at_random_moments_it_comes_to_the_same_weights(prepared, config, tmp_path):
    whole = train(prepared, tmp_path / "whole", config)
    folder = tmp_path / "killed"
    rng = np.random.default_rng(1)
    killed = kill_until_done(
        lambda resume: Forked(prepared, folder, config, resume=resume),
        folder,
        rng.uniform(0.1, 0.8, 3),
    )
    assert killed >= 1
    assert same_weights(whole.folder, folder)
    assert sorted(path.name for path in folder.iterdir()) == FILES
    assert len((folder / "metrics.csv").read_text().splitlines()) == 1 + 3


@pytest.mark.slow
def test_the_command_killed_at_many_moments(prepared, config, tmp_path):
    (tmp_path / "tiny.toml").write_text(config.to_toml())
    train(prepared, tmp_path / "whole", config)
    folder = tmp_path / "killed"

    def start(resume: bool) -> subprocess.Popen[bytes]:
        how = ["--resume", folder] if resume else ["-o", folder, "-c", tmp_path / "tiny.toml"]
        return subprocess.Popen([SCRIPT, "train", prepared, *how, "-q"], cwd=tmp_path)

    delays = np.random.default_rng(2).uniform(0, 1.5, 30)
    assert kill_until_done(start, folder, delays) >= 5
    assert same_weights(tmp_path / "whole", folder)
    assert sorted(path.name for path in folder.iterdir()) == FILES


def test_leftovers_of_a_killed_run_are_removed(prepared, tiny, tmp_path):
    left = [".last-abcd1234.partial.safetensors", ".metrics-0_0_0_0_.partial.csv"]
    for name in [*left, ".mine-abcd1234.partial.safetensors"]:
        (tmp_path / name).write_text("half")
    with pytest.raises(CheckpointError, match="start it without --resume"):
        train(prepared, tmp_path, tiny(), resume=True)
    assert [path.name for path in tmp_path.iterdir()] == [".mine-abcd1234.partial.safetensors"]


@pytest.mark.parametrize("options", [{}, {"resume": True}, {"overwrite": True}])
def test_two_trainings_in_one_folder(prepared, tiny, tmp_path, options):
    with locked(tmp_path), pytest.raises(WriteError, match=rf"\({os.getpid()} on .*at work here"):
        train(prepared, tmp_path, tiny(), **options)


LIMITED = """
import resource, sys
from bushseg_cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)
main()
"""
"""A file that may not grow further looks to us like a disk that is full."""


def test_a_full_disk_is_one_line_and_the_last_checkpoint_stands(prepared, config, tmp_path):
    folder = tmp_path / "run"
    longer = config.model_copy(update={"train": config.train.model_copy(update={"epochs": 50})})
    train(prepared, folder, longer, stop=StopAfter(3))
    before = (folder / LAST).read_bytes()
    arguments = ["train", prepared, "--resume", folder, "--quiet"]
    ended = subprocess.run(
        [sys.executable, "-c", LIMITED, str(len(before) // 2), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1
    assert "last.safetensors: can't be saved" in ended.stderr
    assert "File too large" in ended.stderr
    assert (folder / LAST).read_bytes() == before
    assert not list(folder.glob(".*"))


class StopAfter:
    """Asks for an end before step `steps` (from 0)."""

    def __init__(self, steps: int) -> None:
        self.left = steps

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


def test_within_an_epoch_it_saves_as_often_as_asked(prepared, tiny, tmp_path, monkeypatch):
    saved = []
    monkeypatch.setattr(
        "bushseg.run_files.save_model",
        lambda path, *_, state=None, **__: saved.append((path.name, (state or {}).get("step"))),
    )
    train(prepared, tmp_path / "a", tiny(epochs=1, steps_per_epoch=3, checkpoint_minutes=0))
    assert saved == [(LAST, 1), (LAST, 2), ("best.safetensors", None), (LAST, 0)]
    saved.clear()
    train(prepared, tmp_path / "b", tiny(epochs=1, steps_per_epoch=3))
    assert saved == [("best.safetensors", None), (LAST, 0)]
