"""Whether a disk can hold what is about to be written."""

import shutil
from pathlib import Path

from bushseg.errors import WriteError

SCRATCH_VOXEL = 170
"""Bytes of scratch files that a voxel takes which memory can't hold: its sums, and all its columns;
with color and intensity. `benchmarks/memory.py` measures it."""


def check_room(folder: Path, num_bytes: float, what: str, remedy: str) -> None:
    """Refuse to begin what can't be finished.

    Args:
        folder: Where it will be written; need not exist.
        num_bytes: What it will take, about.
        what: For people: "the labelled scan".
        remedy: What to do besides freeing space.

    Raises:
        WriteError: The disk has less room.
    """
    place = next((path for path in (folder, *folder.resolve().parents) if path.exists()), None)
    try:
        free = shutil.disk_usage(place or folder).free
    except OSError:  # nothing is known of it
        return
    if free < num_bytes:
        raise WriteError(
            f"{folder}: {what} will take about {_readable(num_bytes)}, but {_readable(free)} are "
            f"free; free some space, or {remedy}"
        )


def _readable(num_bytes: float) -> str:
    """A size for people."""
    return f"{num_bytes / 1e9:.2f} GB" if num_bytes >= 1e8 else f"{num_bytes / 1e6:.2f} MB"
