"""PLY: ASCII and binary of either byte order, any properties, faces passed over.

The header is parsed here and not by a library because it must be checked against the file's size
before anything is allocated, and because the vertices of a large scan must stream.
"""

import os
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from bushseg.errors import ReadError
from bushseg.io.ascii import Body, read_rows, skip_lines
from bushseg.io.base import ScanInfo, ScanReader
from bushseg.io.stream import read_records
from bushseg.io.table import (
    Coordinates,
    Table,
    TableReader,
    TableWriter,
    attribute_dtypes,
    find_coordinates,
    find_label,
)

_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_MAX_HEADER_BYTES = 1 << 20
_MAX_DIGITS = 20


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    dtype: np.dtype[Any]
    length: np.dtype[Any] | None = None  # of a list property: the type of its leading count


@dataclass(slots=True)
class _Element:
    name: str
    count: int
    properties: list[_Property]

    @property
    def has_lists(self) -> bool:
        return any(item.length is not None for item in self.properties)

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype([(item.name, item.dtype) for item in self.properties])

    @property
    def min_row_bytes(self) -> int:
        """The size of a row in binary; with lists, of a row whose lists are empty."""
        return sum((item.length or item.dtype).itemsize for item in self.properties)


@dataclass(frozen=True, slots=True)
class _Header:
    format: str
    elements: list[_Element]
    num_bytes: int
    num_lines: int


class PlyReader(TableReader):
    """An open PLY file."""

    def __init__(self, info: ScanInfo, coordinates: Coordinates, body: Body, binary: bool) -> None:
        super().__init__(info, coordinates)
        self._body = body
        self._binary = binary

    def _tables(self, size: int) -> Iterator[Table]:
        body, num_points = self._body, self.info.num_points
        if self._binary:
            return read_records(body.path, body.offset, body.dtype, num_points, size)
        return read_rows(body, size, limit=num_points)


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
    if vertex.has_lists:
        raise ReadError(path, "vertices with a list property", "one number a vertex and property")
    coordinates = find_coordinates(item.name for item in vertex.properties)
    if coordinates is None:
        names = ", ".join(item.name for item in vertex.properties)
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
    attributes = attribute_dtypes(vertex.dtype, coordinates)
    info = ScanInfo(
        path=path,
        format=f"PLY {header.format}",
        num_points=vertex.count,
        attributes=attributes,
        label_attribute=find_label(attributes),
    )
    line = header.num_lines + sum(item.count for item in before) + 1
    return PlyReader(info, coordinates, Body(path, offset, line, vertex.dtype), binary)


def _read_header(path: Path, file: BinaryIO) -> _Header:
    """Parse up to and including the line "end_header"."""
    if file.readline(_MAX_HEADER_BYTES).strip() != b"ply":
        raise ReadError(path, "no 'ply' on its first line", "a PLY file")
    ply_format = order = ""
    elements: list[_Element] = []
    num_lines = 1
    while True:
        raw = file.readline(_MAX_HEADER_BYTES)
        num_lines += 1
        if not raw.endswith(b"\n") or file.tell() > _MAX_HEADER_BYTES:
            raise ReadError(path, "a header without an end", "the line 'end_header'")
        words = raw.decode("latin-1").split()
        match words:
            case ["end_header"]:
                break
            case ["format", ply_format, "1.0"] if ply_format in _BYTE_ORDERS and not elements:
                order = _BYTE_ORDERS[ply_format]
            case ["element", name, count] if (
                order and count.isdecimal() and len(count) <= _MAX_DIGITS
            ):
                elements.append(_Element(name, int(count), []))
            case ["property", "list", length, kind, name] if (
                elements and kind in _TYPES and _TYPES.get(length, "f")[0] != "f"
            ):
                elements[-1].properties.append(
                    _Property(
                        name, np.dtype(order + _TYPES[kind]), np.dtype(order + _TYPES[length])
                    )
                )
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, np.dtype(order + _TYPES[kind])))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ReadError(
                    path, f"header line {num_lines} {' '.join(words)[:60]!r}", "PLY 1.0 syntax"
                )
    for element in elements:
        names = [item.name for item in element.properties]
        if len(set(names)) != len(names):
            raise ReadError(path, f"a property twice in {element.name!r}", "different names")
    return _Header(ply_format, elements, file.tell(), num_lines)


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
            if element.has_lists:
                file.seek(offset)
                _skip_rows_with_lists(path, file, element)
                offset = file.tell()
            else:
                offset += element.count * element.min_row_bytes
    return offset


def _skip_rows_with_lists(path: Path, file: BinaryIO, element: _Element) -> None:
    steps: list[tuple[struct.Struct | None, int]] = []
    for item in element.properties:
        if item.length is None:
            steps.append((None, item.dtype.itemsize))
        else:
            order = ">" if item.length.byteorder == ">" else "<"
            steps.append((struct.Struct(order + item.length.char), item.dtype.itemsize))
    for _ in range(element.count if steps else 0):
        for length, itemsize in steps:
            if length is None:
                file.seek(itemsize, os.SEEK_CUR)
                continue
            raw = file.read(length.size)
            count = length.unpack(raw)[0] if len(raw) == length.size else -1
            if count < 0:
                raise ReadError(
                    path, f"a damaged or truncated list in {element.name!r}", "its length"
                )
            file.seek(count * itemsize, os.SEEK_CUR)


class PlyWriter(TableWriter):
    """Writes binary little-endian PLY, coordinates as double."""

    def _column_dtype(self, dtype: np.dtype[Any]) -> np.dtype[Any]:
        stored = super()._column_dtype(dtype)
        # PLY has no integers of 8 bytes.
        return np.dtype("<f8") if stored.kind in "iu" and stored.itemsize == 8 else stored

    def _header(self, dtype: np.dtype[Any]) -> bytes:
        # The first eight of the table are PLY 1.0's own names, which every program knows.
        names = {code: name for name, code in list(_TYPES.items())[:8]}
        lines = ["ply", "format binary_little_endian 1.0", f"element vertex {self._num_points}"]
        lines += [f"property {names[dtype[name].str[1:]]} {name}" for name in dtype.names or ()]
        return "\n".join([*lines, "end_header", ""]).encode("ascii")


def create_ply(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> PlyWriter:  # noqa: ARG001
    """Create a PLY file for the points of `source`; columns settle with the first chunk."""
    return PlyWriter(path, source)
