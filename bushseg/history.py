"""The metrics of a run's epochs, as a table and as lines."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from bushseg.files import atomic_path


def write_history(path: Path, history: Sequence[dict[str, float]]) -> None:
    """One row an epoch, as CSV; a column for each metric that any epoch has."""
    with atomic_path(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(
            file, fieldnames=list(dict.fromkeys(name for row in history for name in row))
        )
        writer.writeheader()
        writer.writerows(history)


def summarize(row: dict[str, float], epochs: int, seconds_left: float) -> str:
    """An epoch's metrics in one line, and how long the rest will take."""
    parts = [f"epoch {row['epoch']:.0f}/{epochs}  loss {row['loss']:.3f}"]
    if "val_miou" in row:
        parts.append(f"held out: mIoU {row['val_miou']:.1%}, OA {row['val_oa']:.1%}")
        ious = {k.removeprefix("val_iou/"): v for k, v in row.items() if k.startswith("val_iou/")}
        parts.append(", ".join(f"{k} {v:.0%}" for k, v in ious.items() if not math.isnan(v)))
    else:
        parts.append(f"training crops: mIoU {row['train_miou']:.1%}, OA {row['train_oa']:.1%}")
    parts.append(f"{row['points_per_second']:,.0f} points/s")
    if seconds_left > 0:
        parts.append(f"{_duration(seconds_left)} left")
    return "  ".join(parts)


def _duration(seconds: float) -> str:
    """Seconds as people say them: "40 s", "12 min", "3 h 5 min"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"
