"""Arrays with a row a voxel: in memory where they are small, in files of a scratch folder else.

A file is mapped into memory, so that code sees an array either way. Pages that were touched stay
resident until they are let go: whoever passes over such arrays calls :meth:`Scratch.release` now
and then, and memory doesn't grow with the scan.
"""

import mmap
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from bushseg.errors import CacheError, WriteError

ELSEWHERE = "work on another disk: --scratch of predict, --output of prepare"
"""What to do where a disk can't hold scratch files."""

BLOCK_ROWS = 1 << 20
"""Rows that a pass over all voxels handles at a time."""

_MANY_FILES, _MOST_FILES = 100, 10_240
"""A process may keep 256 files open on macOS and 1,024 on Linux, unless it asks for more."""


def blocks(num_rows: int) -> Iterator[slice]:
    """Consecutive slices that cover so many rows."""
    for start in range(0, num_rows, BLOCK_ROWS):
        yield slice(start, min(start + BLOCK_ROWS, num_rows))


class Scratch:
    """Makes arrays of one scan.

    Attributes:
        folder: Where their files stand; None for memory.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder
        self._maps: list[mmap.mmap] = []
        self._files: list[Path] = []

    def empty(self, name: str, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """A new array, to be written to.

        Args:
            name: Unique among the scan's arrays; names the file.
            shape: Its shape.
            dtype: Its dtype.

        Raises:
            WriteError: The disk can't hold it.
        """
        num_bytes = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
        if self.folder is None or not num_bytes:
            return np.empty(shape, dtype)
        path = self.folder / name
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)  # an older array of that name stays what it is
            self._files.append(path)
            with path.open("w+b") as file:
                # Room is taken now: writing to a mapped page that the disk has no room for would
                # kill the process.
                _allocate(file.fileno(), num_bytes)
                return self._mapped(file.fileno(), shape, dtype)
        except OSError as error:
            raise WriteError(
                f"{path}: no room for {num_bytes / 1e9:.1f} GB of scratch data "
                f"({error.strerror or error}); free some space, or {ELSEWHERE}"
            ) from error

    def open(self, name: str, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """An array that stands in the folder already, to be read.

        Raises:
            CacheError: It is missing, or its file has another size.
        """
        num_bytes = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
        if self.folder is None or not num_bytes:
            return np.empty(shape, dtype)
        path = self.folder / name
        try:
            with path.open("r+b") as file:
                found = os.fstat(file.fileno()).st_size
                if found != num_bytes:
                    raise CacheError(f"{path}: {found:,} bytes; expected {num_bytes:,}")
                return self._mapped(file.fileno(), shape, dtype)
        except OSError as error:
            raise CacheError(f"{path}: can't be read ({error.strerror or error})") from error

    def _mapped(self, handle: int, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        if len(self._maps) == _MANY_FILES:
            _allow_files()
        mapped = mmap.mmap(handle, 0)  # keeps the file open
        self._maps.append(mapped)
        return np.frombuffer(mapped, dtype).reshape(shape)

    def blocks(self, num_rows: int) -> Iterator[slice]:
        """As :func:`blocks`; pages are let go after each."""
        for rows in blocks(num_rows):
            yield rows
            self.release()

    def sample(self, column: NDArray[Any], num_rows: int) -> NDArray[Any]:
        """At least so many rows of an array at even distances, or all if it has fewer."""
        step = max(1, len(column) // num_rows)
        parts = [
            column[rows][-rows.start % step :: step].copy() for rows in self.blocks(len(column))
        ]
        return np.concatenate(parts) if parts else column[:0]

    def remove(self) -> None:
        """Delete the files that were made here; their arrays must not be used any more."""
        for path in self._files:
            path.unlink(missing_ok=True)
        self._files, self._maps = [], []

    def sync(self) -> None:
        """Write everything to disk."""
        for mapped in self._maps:
            mapped.flush()

    def release(self) -> None:
        """Let go of the pages of all files; they are read again where they are needed."""
        if hasattr(mmap, "MADV_DONTNEED"):
            for mapped in self._maps:
                mapped.madvise(mmap.MADV_DONTNEED)


def _allocate(handle: int, num_bytes: int) -> None:
    """Take so much room for a new file.

    Raises:
        OSError: There is none.
    """
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, 0, num_bytes)
        return
    zeros = bytes(1 << 20)
    for start in range(0, num_bytes, len(zeros)):
        os.write(handle, zeros[: num_bytes - start])


def _allow_files() -> None:
    """Let this process keep open as many files as the system allows it."""
    try:
        import resource
    except ImportError:  # not on Windows
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, _MOST_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
