"""A run's folder: where a new one goes, what an old one keeps, which model is taken."""

import os
from pathlib import Path

import pytest

from bushseg.errors import CheckpointError, WriteError
from bushseg.runs import (
    BEST,
    CURVES,
    LAST,
    METRICS,
    SETTINGS,
    check_new,
    find_model,
    name_run,
    remove_run,
)


def test_a_new_run_is_named_by_the_time():
    folder = name_run()
    assert folder.parent == Path("runs")
    assert not folder.exists()


def test_a_folder_that_holds_no_run_may_be_used(tmp_path):
    (
        tmp_path / SETTINGS
    ).touch()  # all that a run leaves that was killed before its first checkpoint
    check_new(name_run(str(tmp_path)))


@pytest.mark.parametrize("name", [BEST, LAST])
def test_a_run_is_kept_unless_told_otherwise(tmp_path, name):
    (tmp_path / name).touch()
    with pytest.raises(WriteError, match="holds a run already"):
        check_new(tmp_path)
    check_new(tmp_path, overwrite=True)


def test_only_a_runs_own_files_are_removed(tmp_path):
    for name in (BEST, LAST, METRICS, CURVES, SETTINGS, "notes.txt"):
        (tmp_path / name).touch()
    remove_run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_which_model_is_used(run, tmp_path, monkeypatch):
    assert find_model(run) == run / "best.safetensors"
    assert find_model(run / "last.safetensors") == run / "last.safetensors"
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CheckpointError, match="bushseg train"):
        find_model()
    for age, name in enumerate(("newest", "older", "oldest")):
        path = tmp_path / "runs" / name / "best.safetensors"
        path.parent.mkdir(parents=True)
        path.touch()
        os.utime(path, (1e9 - age, 1e9 - age))
    (tmp_path / "runs" / "unfinished").mkdir()
    assert find_model() == Path("runs/newest/best.safetensors")
