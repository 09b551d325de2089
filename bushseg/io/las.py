"""LAS, LAZ and COPC: the door to the modules that read and write them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.io.base import ScanReader, ScanWriter
from bushseg.io.las_convert import LasConverter
from bushseg.io.las_reader import LasReader
from bushseg.io.las_writer import LasWriter


def open_las(path: Path) -> LasReader:
    """Open a LAS 1.0 to 1.4 or LAZ file, COPC included.

    Raises:
        ReadError: The file isn't what it claims to be, holds no points, or is damaged.
    """
    return LasReader(path)


def create_las(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> ScanWriter:
    """Begin a LAS file, or a LAZ file where `path` ends in `.laz`.

    A LAS or LAZ source is copied bit for bit (:class:`bushseg.io.las_writer.LasWriter`); any other
    becomes LAS 1.4 (:class:`bushseg.io.las_convert.LasConverter`).

    Args:
        path: The file to write.
        source: The open scan whose chunks will be written.
        added: Name to dtype of each added column.

    Raises:
        ReadError: The source can't be read.
        WriteError: The file can't be written, or LAS can't hold what the source holds.
    """
    if isinstance(source, LasReader):
        return LasWriter(path, source, added)
    return LasConverter(path, source, added)
