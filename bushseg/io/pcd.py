"""PCD, the Point Cloud Library's format: ASCII, binary and binary_compressed.

The layout follows the library's public description of version 0.7. Organized clouds (HEIGHT > 1)
are read row after row; points without a return, which are NaN there, are kept.
"""

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.io import lzf
from bushseg.io.base import ScanReader
from bushseg.io.stream import Body, Table
from bushseg.io.table import PADDING, BodyReader, TableWriter, find_coordinates

_KINDS = {"F": "f", "I": "i", "U": "u"}
_TYPE_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_ENCODINGS = ("ascii", "binary", "binary_compressed")
_DEFAULT_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_MAX_LINE_BYTES = 1 << 16
_MAX_DIGITS = 20
_MAX_HEADER_LINES = 1000
_MAX_FIELDS = 10_000
_MAX_POINT_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class _Header:
    dtype: np.dtype[Any]
    num_points: int
    encoding: str
    sensor_position: NDArray[np.float64] | None
    num_bytes: int
    num_lines: int


class CompressedReader(BodyReader):
    """An open PCD file whose body is compressed, which only lets itself be read whole."""

    def _tables(self, size: int) -> Iterator[Table]:
        table = self._decompressed()
        return (table[start : start + size] for start in range(0, len(table), size))

    def _decompressed(self) -> Table:
        """The whole cloud: its one compressed block holds each field's values of all points."""
        dtype, num_points = self._body.dtype, self.info.num_points
        with self.info.path.open("rb") as file:
            file.seek(self._body.offset)
            compressed, size = struct.unpack("<II", file.read(8))
            try:
                raw = lzf.decompress(file.read(compressed), size)
            except ValueError as error:
                raise ReadError(
                    self.info.path, f"a damaged body ({error})", "LZF; fetch the file again"
                ) from error
        table = np.empty(num_points, dtype=dtype)
        offset = 0
        for name in dtype.names or ():
            field = dtype[name]
            table[name] = np.ndarray(num_points, dtype=field, buffer=raw, offset=offset)
            offset += num_points * field.itemsize
        return table


def open_pcd(path: Path) -> ScanReader:
    """Open a PCD file.

    The sensor position is the VIEWPOINT, unless that is the one every writer puts where it knows
    none (the origin, not rotated).

    Raises:
        ReadError: The header is malformed, has no points or no x, y and z, or promises more than
            the file's size can hold.
    """
    with path.open("rb") as file:
        header = _read_header(path, file)
        _check_size(path, file, header)
    names = header.dtype.names or ()
    coordinates = find_coordinates(names)
    if coordinates is None or any(header.dtype[name].shape for name in coordinates):
        raise ReadError(path, f"the fields {', '.join(names)[:200]}", "x, y and z, one value each")
    reader = CompressedReader if header.encoding == "binary_compressed" else BodyReader
    return reader(
        f"PCD {header.encoding}",
        header.num_points,
        Body(path, header.num_bytes, header.num_lines + 1, header.dtype),
        coordinates,
        is_text=header.encoding == "ascii",
        sensor_position=header.sensor_position,
    )


def _read_header(path: Path, file: BinaryIO) -> _Header:
    """Parse up to and including the DATA line."""
    entries: dict[str, list[str]] = {}
    num_lines = 0
    while "DATA" not in entries:
        raw = file.readline(_MAX_LINE_BYTES)
        num_lines += 1
        if not raw.endswith(b"\n") or num_lines > _MAX_HEADER_LINES:
            raise ReadError(path, "a header without a DATA line", "a PCD file")
        # Split as bytes: what Latin-1 calls a space may be part of a UTF-8 letter, such as à.
        words = [word.decode("utf-8", "backslashreplace") for word in raw.split()]
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]

    dtype = _parse_dtype(path, entries)
    width, height = (_integers(path, entries, key, "1")[0] for key in ("WIDTH", "HEIGHT"))
    if "WIDTH" not in entries:
        width = _integers(path, entries, "POINTS")[0]
    num_points = _integers(path, entries, "POINTS", str(width * height))[0]
    if num_points != width * height:
        raise ReadError(
            path, f"POINTS {num_points} but WIDTH x HEIGHT {width} x {height}", "the same number"
        )
    if num_points == 0:
        raise ReadError(path, "0 points", "a point cloud with at least one")
    encoding = " ".join(entries["DATA"]).lower()
    if encoding not in _ENCODINGS:
        raise ReadError(path, f"DATA {encoding[:40]}", "one of " + ", ".join(_ENCODINGS))
    position = _sensor_position(path, entries.get("VIEWPOINT"))
    return _Header(dtype, num_points, encoding, position, file.tell(), num_lines)


def _parse_dtype(path: Path, entries: Mapping[str, list[str]]) -> np.dtype[Any]:
    names = entries.get("FIELDS", entries.get("COLUMNS", []))
    if not 0 < len(names) <= _MAX_FIELDS:
        raise ReadError(path, f"{len(names)} FIELDS", f"1 to {_MAX_FIELDS}")
    ones = " ".join(["1"] * len(names))
    sizes = _integers(path, entries, "SIZE")
    counts = _integers(path, entries, "COUNT", ones)
    types = entries.get("TYPE", [])
    if not len(names) == len(sizes) == len(types) == len(counts):
        raise ReadError(
            path,
            f"{len(names)} FIELDS, {len(sizes)} SIZE, {len(types)} TYPE and {len(counts)} COUNT",
            "one of each a field",
        )
    num_bytes = sum(size * count for size, count in zip(sizes, counts, strict=True))
    if num_bytes > _MAX_POINT_BYTES:
        raise ReadError(path, f"{num_bytes:,} bytes a point", f"at most {_MAX_POINT_BYTES:,}")
    fields: list[tuple[str, str, tuple[int, ...]]] = []
    for index, (name, size, kind, count) in enumerate(
        zip(names, sizes, types, counts, strict=True)
    ):
        if size not in _TYPE_SIZES.get(kind, ()) or count == 0:
            raise ReadError(
                path,
                f"field {name!r} of TYPE {kind}, SIZE {size} and COUNT {count}",
                "TYPE F of 4 or 8 bytes, I or U of 1, 2, 4 or 8, and a COUNT of 1 or more",
            )
        unique = f"{PADDING}{index}" if name == "_" else name
        fields.append((unique, f"<{_KINDS[kind]}{size}", (count,) if count > 1 else ()))
    if len({name for name, *_ in fields}) != len(fields):
        raise ReadError(path, "a field named twice", "a different name for each")
    return np.dtype(fields)


def _integers(
    path: Path, entries: Mapping[str, list[str]], key: str, default: str = ""
) -> list[int]:
    """The numbers of a header line, none negative."""
    words = entries.get(key, default.split())
    if not words or not all(word.isdecimal() and len(word) <= _MAX_DIGITS for word in words):
        found = f"{key} {' '.join(words)[:60]}".rstrip() if key in entries else f"no {key} line"
        raise ReadError(path, found, f"{key} followed by whole numbers")
    return [int(word) for word in words]


def _sensor_position(path: Path, viewpoint: list[str] | None) -> NDArray[np.float64] | None:
    if viewpoint is None:
        return None
    try:
        values = tuple(float(word) for word in viewpoint)
    except ValueError:
        values = ()
    if len(values) != len(_DEFAULT_VIEWPOINT):
        raise ReadError(path, f"VIEWPOINT {' '.join(viewpoint)[:60]}", "seven numbers")
    if values == _DEFAULT_VIEWPOINT or not np.all(np.isfinite(values[:3])):
        return None
    return np.array(values[:3], dtype=np.float64)


def _check_size(path: Path, file: BinaryIO, header: _Header) -> None:
    """Hold the header's promise against the file's size, before anything is allocated."""
    available = path.stat().st_size - header.num_bytes
    needed = header.num_points * header.dtype.itemsize
    if header.encoding == "ascii":
        shapes = (header.dtype[name].shape for name in header.dtype.names or ())
        needed = header.num_points * (2 * sum(int(np.prod(shape)) for shape in shapes) - 1)
    elif header.encoding == "binary_compressed":
        raw = file.read(8)
        compressed, size = struct.unpack("<II", raw) if len(raw) == 8 else (0, 0)
        if size != needed or size > compressed * lzf.MAX_RATIO:
            raise ReadError(
                path,
                f"a body of {compressed:,} bytes that unpacks to {size:,}",
                f"{needed:,} for the {header.num_points:,} points in its header",
            )
        needed = compressed + 8
    if needed > available:
        raise ReadError(
            path,
            f"{available:,} bytes of points",
            f"at least {needed:,} for the {header.num_points:,} points in its header; the file "
            "is truncated",
        )


class PcdWriter(TableWriter):
    """Writes binary PCD, coordinates as 8-byte floats."""

    def __init__(self, path: Path, source: ScanReader) -> None:
        super().__init__(path, source)
        position = source.info.sensor_position
        values = _DEFAULT_VIEWPOINT[:3] if position is None else position.tolist()
        self._viewpoint = " ".join(f"{value!r}" for value in values) + " 1 0 0 0"

    def _header(self, dtype: np.dtype[Any]) -> bytes:
        columns = [dtype[name] for name in dtype.names or ()]
        lines = [
            "# .PCD v0.7 - Point Cloud Data file format",
            "VERSION 0.7",
            "FIELDS " + " ".join(dtype.names or ()),
            "SIZE " + " ".join(str(column.itemsize) for column in columns),
            "TYPE " + " ".join(column.kind.upper() for column in columns),
            "COUNT " + " ".join("1" for _ in columns),
            f"WIDTH {self._num_points}",
            "HEIGHT 1",
            "VIEWPOINT " + self._viewpoint,
            f"POINTS {self._num_points}",
            "DATA binary",
            "",
        ]
        return "\n".join(lines).encode("ascii")


def create_pcd(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> PcdWriter:  # noqa: ARG001
    """Create a PCD file for the points of `source`; columns settle with the first chunk."""
    return PcdWriter(path, source)
