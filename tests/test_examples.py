"""The examples, run in order in an empty folder as their first lines say."""

import os
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples"
ORDER = ["train_a_model.py", "label_a_scan.py", "label_a_frame.py"]


def test_every_example_is_run() -> None:
    assert sorted(path.name for path in EXAMPLES.glob("*.py")) == sorted(ORDER)


def test_examples_run_in_an_empty_folder(tmp_path: Path) -> None:
    outputs = {}
    for name in ORDER:
        done = subprocess.run(
            [sys.executable, str(EXAMPLES / name)],
            cwd=tmp_path,
            env={**os.environ, "PYTHONWARNINGS": "error"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{name}:\n{done.stderr}"
        outputs[name] = done.stdout
    assert "mIoU" in outputs["label_a_scan.py"]
    assert "bush within 5 m" in outputs["label_a_frame.py"]
    assert (tmp_path / "labeled.laz").exists()
