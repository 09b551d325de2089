"""Files that hold class codes and nothing else: `.label` and `.labels`, a code a point.

`.label` is KITTI's and RELLIS-3D's: uint32, the class in the lower 16 bits and an instance number
in the upper. `.labels` is Semantic3D's: an integer a line.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError, WriteError
from bushseg.io.ascii import read_rows
from bushseg.io.base import CHUNK_POINTS, Codes, Columns, ScanReader, ScanWriter
from bushseg.io.sniff import check_file
from bushseg.io.stream import AppendingWriter, Body
from bushseg.points import PointCloud

KITTI_DTYPE = np.dtype("<u4")
KITTI_CLASS_BITS = 16
TEXT_DTYPE = np.dtype([("label", "<i4")])


def read_codes(path: Path) -> NDArray[np.int32]:
    """Read a file of class codes, such as a prediction to be evaluated.

    Returns:
        Codes in the file's order, shape (N,), int32; instance numbers are left out.

    Raises:
        ReadError: The file is none, is empty or is damaged.
    """
    check_file(path)
    if path.suffix.lower() == ".label":
        check_label_size(path)
        packed = np.fromfile(path, dtype=KITTI_DTYPE)
        return (packed & ((1 << KITTI_CLASS_BITS) - 1)).astype(np.int32)
    if path.suffix.lower() != ".labels":
        raise ReadError(path, f"suffix {path.suffix!r}", "class codes in .label or .labels")
    blocks = [rows["label"] for rows in read_rows(Body(path, 0, 1, TEXT_DTYPE), CHUNK_POINTS)]
    if not blocks:
        raise ReadError(path, "no codes", "an integer a line")
    return np.concatenate(blocks).astype(np.int32)


def check_label_size(path: Path) -> int:
    """Return how many codes a `.label` file holds.

    Raises:
        ReadError: Its size isn't a multiple of four bytes.
    """
    size = path.stat().st_size
    if size % KITTI_DTYPE.itemsize:
        raise ReadError(path, f"{size:,} bytes", "a multiple of 4 (uint32 codes); it is truncated")
    return size // KITTI_DTYPE.itemsize


class CodesWriter(AppendingWriter):
    """Writes the codes; points and added columns have no place in these formats.

    Args:
        path: The file to write.
        source: The scan being labelled, which says how many codes will come.
        encode: Codes into the bytes that stand for them.
        limits: The smallest and the largest code the format holds.
    """

    def __init__(
        self,
        path: Path,
        source: ScanReader,
        encode: Callable[[Codes], bytes],
        limits: tuple[int, int],
    ) -> None:
        super().__init__(path, source)
        self._encode = encode
        self._limits = limits

    def write(self, chunk: PointCloud, added: Columns, codes: Codes | None) -> None:  # noqa: ARG002
        """Append one chunk's codes.

        Raises:
            WriteError: There are no codes, one doesn't fit the format, or the disk refuses.
        """
        if codes is None:
            raise WriteError(
                f"{self._path}: no class codes to write, and this format holds nothing else; "
                "choose .ply, .pcd, .csv or .txt"
            )
        smallest, largest = self._limits
        if len(codes) and not smallest <= codes.min() <= codes.max() <= largest:
            raise WriteError(
                f"{self._path}: class codes from {codes.min()} to {codes.max()}; this format holds "
                f"{smallest} to {largest}: map them to such codes"
            )
        self._append(self._encode(codes), len(chunk))


def create_label(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> ScanWriter:  # noqa: ARG001
    """Create a KITTI `.label` file: classes only, no instance numbers."""
    largest = (1 << KITTI_CLASS_BITS) - 1
    return CodesWriter(
        path, source, lambda codes: codes.astype(KITTI_DTYPE).tobytes(), (0, largest)
    )


def create_labels(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> ScanWriter:  # noqa: ARG001
    """Create a Semantic3D `.labels` file."""

    def encode(codes: Codes) -> bytes:
        return "".join(f"{code}\n" for code in codes.tolist()).encode("ascii")

    limits = np.iinfo(np.int32)
    return CodesWriter(path, source, encode, (limits.min, limits.max))
