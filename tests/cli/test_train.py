"""Ctrl-C, once and twice: a process of its own, interrupted as a terminal would."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(sys.executable).with_name("bushseg")


def start_training(prepared: Path, settings: Path, folder: Path) -> subprocess.Popen[str]:
    command = [SCRIPT, "train", prepared, "-o", "run", "-c", settings, "--epochs", "500"]
    return subprocess.Popen(
        list(map(str, command)),
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT to send")
def test_ctrl_c_saves_and_resume_goes_on(prepared, settings, bushseg, tmp_path):
    process = start_training(prepared, settings, tmp_path)
    try:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("epoch 1/500")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0
    assert "Traceback" not in err
    assert "stopping after this step" in err
    assert out.startswith("stopped in epoch")
    assert "--resume run" in out

    finished = len((tmp_path / "run" / "metrics.csv").read_text().splitlines()) - 1
    assert 1 <= finished < 500
    # Its own settings are kept: nothing but the number of epochs is said again.
    again = bushseg("train", prepared, "--resume", "run", "--epochs", finished + 1, "--json")
    assert again.status == 0
    result = json.loads(again.out)
    assert result["epochs"] == finished + 1
    assert [row["epoch"] for row in result["history"]] == list(range(1, finished + 2))
    assert not result["interrupted"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT to send")
def test_ctrl_c_twice_ends_at_once_and_harms_nothing(prepared, settings, bushseg, tmp_path):
    process = start_training(prepared, settings, tmp_path)
    try:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("epoch 1/500")
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        line = ""
        while process.poll() is None and "stopping after this step" not in line:
            line = process.stderr.readline()
        process.send_signal(signal.SIGINT)  # the system may have merged the first two
        _, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert "Traceback" not in err
    assert sorted(path.name for path in (tmp_path / "run").iterdir() if path.name[0] == ".") == []
    finished = len((tmp_path / "run" / "metrics.csv").read_text().splitlines()) - 1
    again = bushseg("train", prepared, "--resume", "run", "--epochs", finished + 1, "--json")
    assert again.status == 0
    assert json.loads(again.out)["epochs"] == finished + 1
