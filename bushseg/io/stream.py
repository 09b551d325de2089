"""Records from a file in chunks, and chunks appended to a file: what the formats' bodies share."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import WriteError
from bushseg.io.base import ScanReader, ScanWriter, chunk_points

Table = NDArray[np.void]
"""A structured array: a row a point, a field a column."""


@dataclass(frozen=True, slots=True)
class Body:
    """Where a file's rows begin and how they read.

    Attributes:
        path: The file.
        offset: Bytes before the first row.
        line: Of text: the number of the first row's line, counting from 1.
        dtype: One field a column; a field of shape (M,) takes M columns.
        delimiter: Of text: what stands between values; None for any white space.
    """

    path: Path
    offset: int
    line: int
    dtype: np.dtype[Any]
    delimiter: str | None = None


def read_records(body: Body, size: int, count: int) -> Iterator[Table]:
    """Yield `count` binary rows in order, at most `size` at a time.

    A file that ends early yields fewer; whoever counts them knows what to say about it.
    """
    size = chunk_points(size, body.dtype.itemsize)
    with body.path.open("rb") as file:
        file.seek(body.offset)
        for start in range(0, count, size):
            yield np.fromfile(file, dtype=body.dtype, count=min(size, count - start))


class AppendingWriter(ScanWriter):
    """An output that only ever grows at its end.

    The file is opened for each chunk, so that a writer given up holds no handle.

    Args:
        path: The file to write.
        source: The scan being copied, which says how many points will come.
    """

    def __init__(self, path: Path, source: ScanReader) -> None:
        self._path = path
        self._num_points = source.info.num_points
        self._num_written = 0

    def _append(self, data: bytes, num_points: int) -> None:
        """Append the bytes that stand for `num_points` points; the first call empties the file.

        Raises:
            WriteError: The disk refuses.
        """
        try:
            with self._path.open("ab" if self._num_written else "wb") as file:
                file.write(data)
        except OSError as error:
            raise WriteError(f"{self._path}: {error.strerror or error}") from error
        self._num_written += num_points

    def close(self) -> None:
        """Check that all points came.

        Raises:
            WriteError: Fewer or more points were written than the source holds.
        """
        if self._num_written != self._num_points:
            raise WriteError(
                f"{self._path}: {self._num_written:,} points written; expected "
                f"{self._num_points:,}; the output is incomplete"
            )
