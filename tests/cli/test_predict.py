"""`bushseg predict` of a folder, and what it says."""

import json
import shutil

import pytest


@pytest.fixture
def some(scans, tmp_path):
    (tmp_path / "scans").mkdir()
    shutil.copy(scans / "north.las", tmp_path / "scans")
    (tmp_path / "scans" / "[bold].las").write_text("no LAS")
    return "scans"


def test_a_folder(bushseg, some, run, scans):
    first = bushseg("predict", some, "-o", "labeled", "-m", run)
    assert first.status == 1
    assert first.out.count("failed: scans/[bold].las:") == 1
    assert "labeled: 1 of 2 scans labelled (4,000 points in " in first.out
    assert "0 done before, 1 failed" in first.out
    assert first.err.startswith("[1 of 2] failed: scans/[bold].las:")
    assert "[2 of 2] labeled/north.las: 4,000 points in " in first.err
    shutil.copy(scans / "south.las", "scans/[bold].las")
    again = bushseg("predict", some, "-o", "labeled", "-m", run, "--json")
    assert (again.status, again.err) == (0, "")
    said = json.loads(again.out)
    assert said["counts"] == {"done": 1, "skipped": 1, "failed": 0, "left": 0}
    assert [scan["status"] for scan in said["scans"]] == ["done", "skipped"]
    assert said["scans"][0]["result"]["features"] == ["rgb", "intensity", "height"]


def test_one_scan_into_a_folder_in_another_format(bushseg, some, run, tmp_path):
    (tmp_path / "labeled").mkdir()
    done = bushseg(
        "predict", "scans/north.las", "-o", "labeled", "-m", run, "--format", "ply", "--verify"
    )
    assert done.status == 0
    assert (tmp_path / "labeled" / "north.ply").exists()


def test_options_that_don_t_go_together(bushseg, some, run):
    assert bushseg("predict", some, "-o", "x", "-m", run, "--profile").status == 2
    assert bushseg("predict", some, "-o", "x", "-m", run, "--format", "docx").status == 1
    one = ("predict", "scans/north.las", "-o", "x.las", "-m", run)
    assert bushseg(*one, "--format", "laz").status == 2


def test_ctrl_c_is_one_line(bushseg, some, run, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("bushseg.prediction.predict_file", interrupt)
    ended = bushseg("predict", "scans/north.las", "-o", "x.las", "-m", run)
    assert ended.status == 130
    assert ended.err.startswith("interrupted; what is done is kept")
    assert ended.err.count("\n") == 1
