"""A training run's folder: what its files are called, which is the newest, what may not be lost.

runs/NAME/
  best.safetensors      the best model on the held-out split (on the training crops where nothing
                        is held out); usable with nothing else
  last.safetensors      the latest, with all that --resume needs
  metrics.csv           one row an epoch
  curves.png            the same, drawn
  config.toml           every setting as it was resolved
"""

from datetime import datetime
from pathlib import Path

from bushseg.errors import CheckpointError, WriteError
from bushseg.files import remove_partials

RUNS = Path("runs")
BEST, LAST, METRICS, CURVES, SETTINGS = _FILES = (
    "best.safetensors",
    "last.safetensors",
    "metrics.csv",
    "curves.png",
    "config.toml",
)


def name_run(run: str | Path | None = None) -> Path:
    """The folder for a run, not created yet: the one given, or one in `runs/` named by the time."""
    return Path(run) if run is not None else RUNS / f"{datetime.now():%Y-%m-%d_%H%M%S}"


def check_new(folder: Path, *, overwrite: bool = False) -> None:
    """Refuse to begin a run where one stands.

    Args:
        folder: The new run's folder.
        overwrite: Whether it may hold a run already.

    Raises:
        WriteError: It holds a run that may not be overwritten.
    """
    if not overwrite and any((folder / name).exists() for name in (BEST, LAST)):
        raise WriteError(
            f"{folder}: holds a run already; go on with it by --resume {folder}, replace it by "
            "--overwrite, or name another folder by --run"
        )


def remove_leftovers(folder: Path) -> None:
    """Remove what killed processes left half written; nobody else may be at work in the folder."""
    for name in _FILES:
        remove_partials(folder / name)


def remove_run(folder: Path) -> None:
    """Remove an earlier run's files, lest its best model be taken for the next run's."""
    for name in _FILES:
        (folder / name).unlink(missing_ok=True)


def find_model(model: str | Path | None = None) -> Path:
    """The model to use: the one named, or the best of the newest run.

    Args:
        model: A model file, a run's folder, or None.

    Raises:
        CheckpointError: There is none.
    """
    if model is not None:
        path = Path(model)
        return path / BEST if path.is_dir() else path
    found = sorted(RUNS.glob(f"*/{BEST}"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise CheckpointError(
            f"no model: {RUNS.absolute()} holds no finished epoch of a run; "
            "train one with `bushseg train`, or name one with --model"
        )
    return found[-1]
