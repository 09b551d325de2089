"""Rows of numbers in chunks, by NumPy's `fromfile` and `loadtxt`, and a scan's columns in them."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError

Columns = dict[str, NDArray[Any]]

_XYZ = (("x", "y", "z"), ("easting", "northing", "height"))


@dataclass(frozen=True, slots=True)
class Scan:
    """A scan as another library reads it.

    Attributes:
        chunks: Given a size, yields all points in order, at most so many at a time: "xyz", shape
            (n, 3), float64, and every attribute in the file's order, shape (n,) or (n, M).
        complete: Whether these are all attributes the file has.
    """

    chunks: Callable[[int], Iterator[Columns]]
    complete: bool = True


def table(rows: Callable[[int], Iterator[NDArray[np.void]]]) -> Scan:
    """A scan whose rows are read by a function of the chunk's size."""
    return Scan(lambda size: map(columns, rows(size)))


def columns(rows: NDArray[np.void]) -> Columns:
    """Coordinates and attributes of rows."""
    names = rows.dtype.names or ()
    found = find_xyz(names)
    if found is None:
        raise ValueError(f"no x, y and z among {', '.join(names)}")
    with np.errstate(invalid="ignore"):
        xyz = np.stack([rows[name].astype(np.float64) for name in found], axis=1)
    rest = {name: rows[name] for name in names if name not in found and not name.startswith("\0")}
    return {"xyz": xyz, **rest}


def find_xyz(names: Sequence[str]) -> tuple[str, ...] | None:
    """The names of the columns that hold coordinates, or None."""
    lower = {name.lower(): name for name in reversed(names)}
    for known in ({name: name for name in names}, lower):
        for wanted in _XYZ:
            if all(name in known for name in wanted):
                return tuple(known[name] for name in wanted)
    return None


def records(
    path: Path, offset: int, dtype: np.dtype[Any], count: int, size: int
) -> Iterator[NDArray[np.void]]:
    """`count` binary rows from a byte of the file on."""
    with path.open("rb") as file:
        file.seek(offset)
        for start in range(0, count, size):
            rows = np.fromfile(file, dtype, min(size, count - start))
            if len(rows) < min(size, count - start):
                raise ReadError(path, f"{start + len(rows):,} points", f"{count:,}, as it says")
            yield rows


def lines(
    path: Path,
    offset: int,
    num_skipped: int,
    dtype: np.dtype[Any],
    delimiter: str | None,
    count: int | None,
    size: int,
) -> Iterator[NDArray[np.void]]:
    """Rows of text from a byte of the file on; blank lines and comments are passed over."""
    with path.open("rb") as file:
        file.seek(offset)
        filled = (line for line in file if line.strip())
        found = (line for line in filled if not line.lstrip().startswith((b"#", b"//")))
        for _ in itertools.islice(found, num_skipped):
            pass
        left = count
        while left is None or left:
            wanted = size if left is None else min(size, left)
            block = list(itertools.islice(found, wanted))
            if block:
                yield np.loadtxt(block, dtype, delimiter=delimiter, ndmin=1, comments=None)
            if left is not None:
                left -= len(block)
            if len(block) < wanted:
                if left:
                    raise ReadError(path, f"{left:,} points too few", f"{count:,}, as it says")
                return
