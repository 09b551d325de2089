"""Sizes that keep `predict`, or `prepare`, within a given memory.

Three things take it: the program itself with its compiled loops; while a scan is read, a table of
voxels and chunks of points; while it is labelled, one tile and the network's features of it. The
last two don't come at once. `benchmarks/memory.py` measures the figures.
"""

import ctypes
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from bushseg.errors import ConfigError

PROGRAM = 800_000_000
"""Bytes of the program with PyTorch, its compiled loops and a network, and of what is allocated and
not in use."""

READING = 700_000_000
"""Bytes of the program and a chunk of points on its way into voxels, the table aside."""

TILE_VOXEL = 1_200
"""Bytes that a voxel of a tile or its halo takes while it is labelled."""

TABLE_VOXEL = 200
"""Bytes that a voxel takes in the table, which is sorted in the end."""

CLASS_VOXEL = 8
"""Bytes more of it for each class that its points may vote for."""

PREPARING = 450_000_000
"""Bytes of `prepare`, which loads no network, the table or the tile that is cut aside: a chunk of
points, a piece of the scan on its way to normals, tiles that crops are drawn from."""

CUT_VOXEL = 200
"""Bytes that a voxel of a tile or its halo takes while the tile is cut and written."""

HALO = 1.3
"""Voxels of a tile with its halo, per voxel of its core. Small tiles have more halo: under a limit
they are cut until they fit (:func:`bushseg.labeler.cut`)."""

_LEAST_TILE, _MOST_TILE = 100_000, 5_000_000
_LEAST_TABLE, _MOST_TABLE = 1 << 18, 1 << 22
_UNITS = ("", "k", "m", "g", "t")
_ARENA_MAX, _MMAP_THRESHOLD = -8, -3  # malloc.h
_PEAK = re.compile(rb"^VmHWM:\s*(\d+) kB$", re.MULTILINE)
_SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]?)(i?)b?\s*", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True, slots=True)
class Sizes:
    """What memory is spent on.

    Attributes:
        tile_points: Voxels in a tile's core.
        max_voxels: Voxels in the table, before they go to disk.
        workers: Processes that label at once; where there are several, beside this one.
    """

    tile_points: int
    max_voxels: int
    workers: int = 1

    @property
    def num_bytes(self) -> int:
        """The memory they take, at most."""
        worker = PROGRAM + int(HALO * TILE_VOXEL * self.tile_points)
        labelling = self.workers * worker + (READING if self.workers > 1 else 0)
        return max(labelling, READING + TABLE_VOXEL * self.max_voxels)


LEAST = Sizes(_LEAST_TILE, _LEAST_TABLE)
"""Below this, tiles would be little more than halo."""


def parse_size(text: str) -> int:
    """Bytes from "2GB", "1.5 GiB", "800M" or a plain number.

    Raises:
        ConfigError: It is none of these.
    """
    found = _SIZE.fullmatch(text)
    if found is None:
        raise ConfigError(f"{text!r} is no size; expected a number and a unit, such as 2GB")
    number, unit, binary = found.groups()
    return int(float(number) * (1024 if binary else 1000) ** _UNITS.index(unit.lower()))


def fit(max_memory: int, workers: int = 1) -> Sizes:
    """The largest sizes that keep within so many bytes.

    Args:
        max_memory: Bytes of all processes together.
        workers: How many of them label.

    Raises:
        ConfigError: Nothing does.
    """
    least = replace(LEAST, workers=workers)
    if max_memory < least.num_bytes:
        processes = f" in {workers} processes" if workers > 1 else ""
        raise ConfigError(
            f"max_memory is {max_memory / 1e9:.2f} GB; labelling{processes} takes at least "
            f"{least.num_bytes / 1e9:.2f} GB: allow as much{', or fewer' if workers > 1 else ''}"
        )
    each = share(max_memory, workers)
    return Sizes(
        tile_points=min(int((each - PROGRAM) / (HALO * TILE_VOXEL)), _MOST_TILE),
        max_voxels=min((max_memory - READING) // TABLE_VOXEL, _MOST_TABLE),
        workers=workers,
    )


def fit_table(max_memory: int | str, tile_points: int, num_classes: int, workers: int = 1) -> int:
    """How many voxels a process of `prepare` may hold in memory while it reads a scan.

    Args:
        max_memory: Bytes of all processes together, or a size such as "2GB".
        tile_points: Voxels in a tile's core.
        num_classes: Classes that a voxel's points may vote for.
        workers: Processes that read scans at once; where there are several, beside this one.

    Raises:
        ConfigError: No number of them would do.
    """
    if isinstance(max_memory, str):
        max_memory = parse_size(max_memory)
    voxel = TABLE_VOXEL + CLASS_VOXEL * num_classes
    each = PREPARING + max(voxel * _LEAST_TABLE, int(HALO * CUT_VOXEL * tile_points))
    least = workers * each + (READING if workers > 1 else 0)
    if max_memory < least:
        processes = f" in {workers} processes" if workers > 1 else ""
        raise ConfigError(
            f"max_memory is {max_memory / 1e9:.2f} GB; preparing tiles of {tile_points:,} voxels"
            f"{processes} takes at least {least / 1e9:.2f} GB: allow as much"
            f"{', or fewer' if workers > 1 else ''}"
        )
    return min((share(max_memory, workers) - PREPARING) // voxel, _MOST_TABLE)


def share(max_memory: int, workers: int) -> int:
    """What each of several processes that work may take, in bytes; this one keeps its own."""
    return (max_memory - READING) // workers if workers > 1 else max_memory


def be_lean() -> None:
    """Have memory that is not in use go back to the system, at some cost in time.

    glibc keeps an arena a thread, and what was freed of arrays of some megabytes for the next ones.
    """
    if (libc := _libc()) is not None:
        libc.mallopt(_ARENA_MAX, 2)
        libc.mallopt(_MMAP_THRESHOLD, 1 << 20)


def give_back() -> None:
    """Return freed memory to the system: glibc keeps it, in pieces the next tile won't fit."""
    if (libc := _libc()) is not None:
        libc.malloc_trim(0)


def peak_memory(process: int | None = None) -> int | None:
    """The largest resident size that a process has had so far, in bytes; None where unknown.

    Linux has it in /proc. What getrusage says there is at least the size of the process that
    started this one, since it counts what came before this one's own program, too.

    Args:
        process: The number of another process, which is known on Linux alone; None for this one.
    """
    try:
        status = Path(f"/proc/{process or 'self'}/status").read_bytes()
    except OSError:  # no Linux, or it has ended
        status = b""
    if (found := _PEAK.search(status)) is not None:
        return 1024 * int(found[1])
    if process is not None:
        return None
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def _libc() -> ctypes.CDLL | None:
    """The C library, if it is glibc."""
    if sys.platform != "linux":
        return None
    libc = ctypes.CDLL(None)
    return libc if hasattr(libc, "malloc_trim") else None
