"""The points of a LAS or LAZ file as the bytes they are, in chunks."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.verification.las_container import LASZIP, Container

CHUNK_POINTS = 500_000
_CHUNK_BYTES = 1 << 25

Raw = NDArray[np.uint8]


def chunk_points(*containers: Container) -> int:
    """How many points of each to hold at a time."""
    return max(1, min(CHUNK_POINTS, _CHUNK_BYTES // max(c.record_bytes for c in containers)))


def raw_points(container: Container, size: int) -> Iterator[Raw]:
    """All points in the file's order, at most `size` at a time, shape (n, record_bytes).

    Raises:
        ReadError: They can't be decompressed.
    """
    opened = _decompressed if container.compressed else _stored
    with opened(container) as stream:
        for first in range(0, container.num_points, size):
            num_points = min(size, container.num_points - first)
            raw = np.empty((num_points, container.record_bytes), np.uint8)
            view = raw.reshape(-1).data
            got = 0
            while got < len(view) and (count := stream.readinto(view[got:])):  # type: ignore[attr-defined]
                got += count
            if got < len(view):
                whole = first + got // container.record_bytes
                raise ReadError(
                    container.path,
                    f"points that don't decode, or end, after {whole:,}",
                    f"{container.num_points:,} as the header counts; the file is damaged",
                )
            yield raw


@contextmanager
def _stored(container: Container) -> Iterator[BinaryIO]:
    with container.path.open("rb") as file:
        file.seek(container.point_offset)
        yield file


@contextmanager
def _decompressed(container: Container) -> Iterator[BinaryIO]:
    """What a process of its own decompresses; its death ends the stream, and nothing else."""
    vlr = next((record for record in container.vlrs if record.key == LASZIP), None)
    if vlr is None:
        raise ReadError(container.path, "compressed points without a LASzip VLR", "one")
    numbers = (container.point_offset, container.num_points * container.record_bytes)
    program = str(Path(__file__).with_name("decompress.py"))
    command = [sys.executable, program, str(container.path.absolute())]
    child = subprocess.Popen(
        [*command, *map(str, (*numbers, vlr.start, vlr.length))],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # why it died is of no use to who reads that it is damaged
    )
    assert child.stdout is not None
    try:
        with child.stdout as stream:
            yield stream  # type: ignore[misc]
    finally:
        child.kill()
        child.wait()
