"""What every format's reader and writer must do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bushseg.points import AttributeArray, PointCloud

CHUNK_POINTS = 1_000_000
CHUNK_BYTES = 1 << 27

Columns = Mapping[str, AttributeArray]
"""Name to values, one a point."""
Codes = NDArray[np.integer[Any]]
"""Class codes, shape (N,)."""


def chunk_points(size: int, point_bytes: int) -> int:
    """How many points a chunk of at most `size` may hold.

    A file says how many bytes a point has: at 65,535 of them a million points wouldn't fit into
    memory.
    """
    return max(1, min(size, CHUNK_BYTES // point_bytes))


@dataclass(frozen=True, slots=True)
class ScanInfo:
    """What a scan's header says, before any point is read.

    Attributes:
        path: The file.
        format: For people: "LAS 1.4 point format 7", "PLY binary_little_endian".
        num_points: How many points the file holds.
        attributes: Name to dtype of each column besides the coordinates; of a multi-valued one a
            sub-array dtype.
        label_attribute: The column that holds class codes, or None.
        bounds: (2, 3) float64, the header's minimum and maximum in the file's unit, or None.
        crs: The coordinate reference system as WKT or as the GeoTIFF keys in words, or None.
        sensor_position: (3,) float64, where the sensor stood in the scan's coordinates; or None.
        no_returns_at_origin: Whether a point at exactly (0, 0, 0) stands for a pulse that did not
            return: kept in every output, never fed to the network.
        waveforms: The file beside the scan in which its points' waveforms are, whether or not it is
            there; None where it has none, or has them inside.
    """

    path: Path
    format: str
    num_points: int
    attributes: Mapping[str, np.dtype[Any]]
    label_attribute: str | None = None
    bounds: NDArray[np.float64] | None = None
    crs: str | None = None
    sensor_position: NDArray[np.float64] | None = None
    no_returns_at_origin: bool = False
    waveforms: Path | None = None


class ScanReader(ABC):
    """An open scan: a context manager that yields its points in order, in chunks.

    Opening validates the header against the file's size, so that a hostile header never sizes an
    allocation. Every failure, on opening or later, is a :class:`bushseg.errors.ReadError`.
    """

    info: ScanInfo

    @abstractmethod
    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        """Yield all points in the file's order, at most `size` at a time.

        May be called more than once; each call starts at the first point.

        Raises:
            ReadError: The body is shorter than the header says, or damaged.
        """

    def read(self) -> PointCloud:
        """Read the whole scan into memory."""
        chunks = list(self.chunks())
        if len(chunks) == 1:
            return chunks[0]
        names = chunks[0].attributes
        return PointCloud(
            np.concatenate([chunk.xyz for chunk in chunks]),
            {name: np.concatenate([chunk.attributes[name] for chunk in chunks]) for name in names},
        )

    def close(self) -> None:  # noqa: B027 - most readers hold nothing open
        """Release the file."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class ScanWriter(ABC):
    """An output being written, chunk by chunk, in the input's order.

    A context manager: leaving it finishes the output, or gives it up if an error was raised. A
    writer writes to the very path it is given; the caller makes that atomic
    (:func:`bushseg.files.atomic_path`).

    Attributes:
        has_legacy_codes: Whether the format's own label field has five bits, as LAS's point formats
            0 to 5 have; see :func:`bushseg.labels.fit_legacy`.
    """

    has_legacy_codes: bool = False

    @abstractmethod
    def write(self, chunk: PointCloud, added: Columns, codes: Codes | None) -> None:
        """Write one chunk.

        Args:
            chunk: N points as the input's reader gave them.
            added: New columns, shape (N,) each, of the names and dtypes that were announced.
            codes: Class codes for the format's own label field, shape (N,), or None to leave it
                alone.

        Raises:
            WriteError: The disk refuses, or a code or value doesn't fit what the format can store.
        """

    @abstractmethod
    def close(self) -> None:
        """Write what comes last (counts, EVLRs) and release the file, even if that fails.

        Raises:
            WriteError: The disk refuses, or points are missing.
        """

    def abort(self) -> None:  # noqa: B027 - most writers hold nothing open
        """Release the file as it stands: whoever asked for it will throw it away."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()
