"""PLY: ASCII and binary of either byte order, any properties, faces passed over.

plyfile parses and writes the headers. The points are read here: it would allocate what a header
claims before looking for it, hold the whole scan, and parse text a row at a time in Python.
"""

import io
import os
import string
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal
from urllib.parse import quote, unquote

import numpy as np
from plyfile import PlyData, PlyElement, PlyListProperty, PlyParseError

from bushseg.errors import ReadError
from bushseg.io.ascii import skip_lines
from bushseg.io.base import ScanReader
from bushseg.io.stream import Body
from bushseg.io.table import BodyReader, TableWriter, find_coordinates

_FORMATS = {"=": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}
_MAX_HEADER_BYTES = 1 << 20
_MAX_DIGITS = 20
_PLAIN = string.punctuation.replace("%", "")


@dataclass(frozen=True, slots=True)
class _Element:
    """Rows of one kind: the vertices, say.

    Attributes:
        name: What the header calls them.
        count: How many rows the header claims.
        dtype: One field a property; of a list property, the type of its items.
        lengths: List property to the type of the number before its items.
    """

    name: str
    count: int
    dtype: np.dtype[Any]
    lengths: Mapping[str, np.dtype[Any]]

    @property
    def properties(self) -> tuple[str, ...]:
        return self.dtype.names or ()

    @property
    def min_row_bytes(self) -> int:
        """The size of a row in binary; with lists, of a row whose lists are empty."""
        return sum(self.lengths.get(name, self.dtype[name]).itemsize for name in self.properties)


@dataclass(frozen=True, slots=True)
class _Header:
    format: str
    elements: list[_Element]
    num_bytes: int
    num_lines: int


def open_ply(path: Path) -> ScanReader:
    """Open a PLY file.

    Raises:
        ReadError: The header is malformed, has no vertices with x, y and z, or promises more than
            the file's size can hold.
    """
    with path.open("rb") as file:
        header = _read_header(path, file)
    vertex = next((item for item in header.elements if item.name == "vertex"), None)
    if vertex is None or vertex.count == 0:
        found = "no vertex element" if vertex is None else "0 vertices"
        raise ReadError(path, found, "a point cloud with at least one vertex")
    if vertex.lengths:
        raise ReadError(path, "vertices with a list property", "one number a vertex and property")
    coordinates = find_coordinates(vertex.properties)
    if coordinates is None:
        names = ", ".join(vertex.properties)
        raise ReadError(path, f"vertices with the properties {names}", "x, y and z among them")

    binary = header.format != "ascii"
    before = header.elements[: header.elements.index(vertex)]
    if binary:
        offset = _skip_binary(path, header, before)
        min_row_bytes = vertex.min_row_bytes
    else:
        offset = skip_lines(path, header.num_bytes, sum(item.count for item in before))
        min_row_bytes = 2 * len(vertex.properties) - 1  # digits and what separates them
    available = path.stat().st_size - offset
    if vertex.count * min_row_bytes > available:
        raise ReadError(
            path,
            f"{available:,} bytes of vertices",
            f"at least {vertex.count * min_row_bytes:,} for the {vertex.count:,} in its header; "
            "the file is truncated",
        )
    line = header.num_lines + sum(item.count for item in before) + 1
    body = Body(path, offset, line, vertex.dtype)
    name = f"PLY {header.format}"
    return BodyReader(name, vertex.count, body, coordinates, is_text=not binary)


def _read_header(path: Path, file: BinaryIO) -> _Header:
    """Parse up to and including the line "end_header".

    plyfile sees the header with every count 0, for it allocates the counts it sees, and in ASCII,
    for it takes nothing else: other characters are percent-encoded meanwhile.
    """
    lines: list[str] = []
    counts: list[int] = []
    while lines[-1:] != ["end_header"]:
        raw = file.readline(_MAX_HEADER_BYTES)
        words = [quote(word, safe=_PLAIN) for word in raw.split()]
        if not lines and words != ["ply"]:
            raise ReadError(path, "no 'ply' on its first line", "a PLY file")
        if not raw.endswith(b"\n") or file.tell() > _MAX_HEADER_BYTES:
            raise ReadError(path, "a header without an end", "the line 'end_header'")
        match words:
            case [] | ["obj_info", *_]:  # plyfile takes neither everywhere
                words = ["comment"]
            case ["element", _, count] if count.isdecimal() and len(count) <= _MAX_DIGITS:
                counts.append(int(count))
                words[2] = "0"
            case ["element", *_]:
                found = f"{' '.join(words)[:60]!r} in header line {len(lines) + 1}"
                raise ReadError(path, found, "an element's name and count")
        lines.append(" ".join(words))
    try:
        ply = PlyData.read(io.BytesIO("\n".join([*lines, ""]).encode("ascii")), mmap=False)
        elements = [
            _parse_element(element, count, ply.byte_order)
            for element, count in zip(ply.elements, counts, strict=True)
        ]
    except (PlyParseError, ValueError) as error:
        raise ReadError(
            path, f"a malformed header ({error})", "PLY 1.0; export it again"
        ) from error
    return _Header(_FORMATS[ply.byte_order], elements, file.tell(), len(lines))


def _parse_element(element: PlyElement, count: int, order: str) -> _Element:
    fields: list[tuple[str, np.dtype[Any]]] = []  # NumPy refuses a name given twice
    lengths: dict[str, np.dtype[Any]] = {}
    for item in element.properties:
        name = unquote(item.name, errors="backslashreplace")
        if isinstance(item, PlyListProperty):
            lengths[name], dtype = map(np.dtype, item.list_dtype(order))
            if lengths[name].kind == "f":
                raise ValueError(f"the length of list {name!r} is a float")
        else:
            dtype = np.dtype(item.dtype(order))
        fields.append((name, dtype))
    return _Element(unquote(element.name), count, np.dtype(fields), lengths)


def _skip_binary(path: Path, header: _Header, elements: list[_Element]) -> int:
    """Return the offset after `elements`, walking through those whose rows differ in length."""
    size = path.stat().st_size
    offset = header.num_bytes
    with path.open("rb") as file:
        for element in elements:
            if offset + element.count * element.min_row_bytes > size:
                raise ReadError(
                    path,
                    f"{size:,} bytes",
                    f"more for the {element.count:,} rows of {element.name!r} in its header; the "
                    "file is truncated",
                )
            if element.lengths:
                file.seek(offset)
                _skip_rows_with_lists(path, file, element)
                offset = file.tell()
            else:
                offset += element.count * element.min_row_bytes
    return offset


def _skip_rows_with_lists(path: Path, file: BinaryIO, element: _Element) -> None:
    steps = [(element.lengths.get(name), element.dtype[name]) for name in element.properties]
    for _ in range(element.count):
        for length, item in steps:
            num_items = 1
            if length is not None:
                raw = file.read(length.itemsize)
                order: Literal["big", "little"] = "big" if length.byteorder == ">" else "little"
                num_items = int.from_bytes(raw, order, signed=length.kind == "i")
                if len(raw) < length.itemsize or num_items < 0:
                    raise ReadError(
                        path, f"a damaged or truncated list in {element.name!r}", "its length"
                    )
            file.seek(num_items * item.itemsize, os.SEEK_CUR)


class PlyWriter(TableWriter):
    """Writes binary little-endian PLY, coordinates as double."""

    def _column_dtype(self, dtype: np.dtype[Any]) -> np.dtype[Any]:
        stored = super()._column_dtype(dtype)
        # PLY has no integers of 8 bytes.
        return np.dtype("<f8") if stored.kind in "iu" and stored.itemsize == 8 else stored

    def _header(self, dtype: np.dtype[Any]) -> bytes:
        # A view that repeats one row: plyfile describes data, and none is needed for a header.
        rows = np.broadcast_to(np.zeros((), dtype), self._num_points)
        ply = PlyData([PlyElement.describe(rows, "vertex")], byte_order="<")
        return f"{ply.header}\n".encode("ascii")


def create_ply(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> PlyWriter:  # noqa: ARG001
    """Create a PLY file for the points of `source`; columns settle with the first chunk."""
    return PlyWriter(path, source)
