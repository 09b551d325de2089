"""Whether a disk can hold what is about to be written, and whether it was full."""

import errno
import os
import re
import shutil
from pathlib import Path

from bushseg.errors import WriteError

SCRATCH_VOXEL = 170
"""Bytes of scratch files that a voxel takes which memory can't hold: its sums, and all its columns;
with color and intensity. `benchmarks/memory.py` measures it."""

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)
"""What the system says when nothing else could be written either."""


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


def is_full(error: BaseException) -> bool:
    """Whether the disk is to blame for an error, so that no other work would fare better.

    Of an error in another process, the line that :func:`with_reason` made there tells.
    """
    told = any(os.strerror(number) in str(error) for number in _FULL)
    return told or _full(error) is not None


def with_reason(message: str, error: BaseException) -> str:
    """An error's line, which names a full disk if that was the cause."""
    number = _full(error)
    if number is None or os.strerror(number) in message:
        return message
    return f"{message} ({os.strerror(number)})"


def _full(error: BaseException | None) -> int | None:
    """The system's word for a full disk, at the bottom of an error; None where it was another."""
    while error is not None:
        # What libraries written in Rust say of the system ends so.
        told = re.search(r"\(os error (\d+)\)", str(error))
        number = error.errno if isinstance(error, OSError) else told and int(told[1])
        if number in _FULL:
            return number
        error = error.__cause__ or error.__context__
    return None


def _readable(num_bytes: float) -> str:
    """A size for people."""
    return f"{num_bytes / 1e9:.2f} GB" if num_bytes >= 1e8 else f"{num_bytes / 1e6:.2f} MB"
