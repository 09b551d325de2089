"""Scans that are one table: a row a point, a named column a property.

PLY, PCD and text differ in how they lay a table out, not in what it holds. What they share stands
here: structured arrays into point clouds and back, which columns mean coordinates or labels, and
what columns an output gets.
"""

import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.errors import ReadError, WriteError
from bushseg.io.ascii import read_rows
from bushseg.io.base import CHUNK_POINTS, Codes, Columns, ScanInfo, ScanReader
from bushseg.io.stream import AppendingWriter, Body, Table, read_records
from bushseg.points import AttributeArray, FloatArray, PointCloud

Coordinates = tuple[str, str, str]

PADDING = "\0"
"""Columns whose names begin so exist in the file only to fill space."""
LABEL = "label"
PREDICTED_LABEL = "predicted_label"
"""Where new codes go when the input has a "label" of its own."""

# Names a column of class codes goes by, most certain first; CloudCompare puts "scalar_" before it.
_LABEL_NAMES = (
    "label",
    "labels",
    "class",
    "classification",
    "semantic",
    "semantic_label",
    "semantic_id",
    "class_id",
    "label_id",
    "category",
)
_COORDINATE_NAMES = (("x", "y", "z"), ("easting", "northing", "height"))
_LARGEST_EXACT_INTEGER = 2**53


def find_label(names: Iterable[str]) -> str | None:
    """Choose the column that holds class codes, whatever its case, or None."""
    by_name = {name.lower().removeprefix("scalar_"): name for name in reversed(list(names))}
    return next((by_name[name] for name in _LABEL_NAMES if name in by_name), None)


def find_coordinates(names: Iterable[str]) -> Coordinates | None:
    """Choose the columns that hold the coordinates: as written, else whatever their case."""
    exact = {name: name for name in names}
    any_case = {name.lower(): name for name in reversed(list(exact))}
    for known in (exact, any_case):
        for x, y, z in _COORDINATE_NAMES:
            if x in known and y in known and z in known:
                return known[x], known[y], known[z]
    return None


def attribute_dtypes(dtype: np.dtype[Any], coordinates: Coordinates) -> dict[str, np.dtype[Any]]:
    """Columns besides the coordinates, in native byte order; unnamed padding is left out."""
    fields = {name: dtype[name].newbyteorder("=") for name in dtype.names or ()}
    return {
        name: field
        for name, field in fields.items()
        if name not in coordinates and not name.startswith(PADDING)
    }


class TableReader(ScanReader):
    """A scan whose format yields structured arrays.

    Args:
        info: What the header says; its attributes are the columns that are handed on.
        coordinates: The columns that hold x, y and z, of any numeric type.
    """

    def __init__(self, info: ScanInfo, coordinates: Coordinates) -> None:
        self.info = info
        self._coordinates = coordinates

    @abstractmethod
    def _tables(self, size: int) -> Iterator[Table]:
        """Yield all rows in order, at most `size` at a time."""

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        """Yield all points in the file's order, at most `size` at a time.

        Raises:
            ReadError: The body holds fewer points than the header says, or is damaged.
        """
        num_read = 0
        try:
            for table in self._tables(size):
                num_read += len(table)
                yield self._point_cloud(table)
        except OSError as error:
            raise ReadError(
                self.info.path,
                f"a read error after {num_read:,} points ({error.strerror or error})",
                f"{self.info.num_points:,} points; check the disk",
            ) from error
        if num_read != self.info.num_points:
            raise ReadError(
                self.info.path,
                f"{num_read:,} points",
                f"{self.info.num_points:,}; the file is truncated or changed while being read",
            )

    def _point_cloud(self, table: Table) -> PointCloud:
        xyz = np.empty((len(table), 3), dtype=np.float64)
        with np.errstate(invalid="ignore"):  # a signaling NaN is as good a NaN as any
            for axis, name in enumerate(self._coordinates):
                xyz[:, axis] = table[name]
        # Copies, so that a cloud doesn't keep the whole table (or a mapped file) alive.
        attributes = {
            name: np.array(table[name], dtype=dtype.base)
            for name, dtype in self.info.attributes.items()
        }
        return PointCloud(xyz, attributes)


class BodyReader(TableReader):
    """A scan whose rows follow each other in one stretch of the file, as text or binary.

    Args:
        name: The format's, for people.
        num_points: How many rows there are.
        body: Where they begin, and their columns.
        coordinates: The columns that hold x, y and z.
        is_text: Whether the rows are lines of text.
        sensor_position: Where the sensor stood, shape (3,), or None.
    """

    def __init__(
        self,
        name: str,
        num_points: int,
        body: Body,
        coordinates: Coordinates,
        *,
        is_text: bool,
        sensor_position: FloatArray | None = None,
    ) -> None:
        attributes = attribute_dtypes(body.dtype, coordinates)
        info = ScanInfo(
            path=body.path,
            format=name,
            num_points=num_points,
            attributes=attributes,
            label_attribute=find_label(attributes),
            sensor_position=sensor_position,
        )
        super().__init__(info, coordinates)
        self._body = body
        self._is_text = is_text

    def _tables(self, size: int) -> Iterator[Table]:
        read = read_rows if self._is_text else read_records
        return read(self._body, size, self.info.num_points)


class TableWriter(AppendingWriter):
    """Writes coordinates, all attributes, added columns and codes as the columns of one table.

    A column of M values a point becomes M columns name_0 ... name_M-1. Codes go to "label", or to
    "predicted_label" where the input has a "label" of its own. The layout is settled by the first
    chunk.

    Args:
        path: The file to write.
        source: The scan being copied, which says how many points will come.
    """

    def __init__(self, path: Path, source: ScanReader) -> None:
        super().__init__(path, source)
        self._dtype: np.dtype[Any] | None = None

    @abstractmethod
    def _header(self, dtype: np.dtype[Any]) -> bytes:
        """What the file begins with, for rows of `dtype`."""

    def _rows(self, table: Table) -> bytes:
        """The rows of `table` as the format stores them; binary by default."""
        return table.tobytes()

    def _column_name(self, name: str) -> str:
        """The column's name as the format can hold it."""
        printable = re.sub(r"[^!-~]+", "_", name)
        # A bare "_" is PCD's name for padding, which readers drop.
        return printable if printable.strip("_") else "column"

    def _column_dtype(self, dtype: np.dtype[Any]) -> np.dtype[Any]:
        """The type the format stores values of `dtype` as; numbers of any size by default."""
        if dtype.kind == "b":
            return np.dtype("u1")
        if dtype.kind == "f":
            return np.dtype("<f4" if dtype.itemsize <= 4 else "<f8")
        if dtype.kind in "iu":
            return dtype.newbyteorder("<")
        raise WriteError(f"{self._path}: can't store a column of type {dtype}; drop it first")

    def write(self, chunk: PointCloud, added: Columns, codes: Codes | None) -> None:
        """Append one chunk; see :meth:`bushseg.io.base.ScanWriter.write`.

        Raises:
            WriteError: The disk refuses, or a value doesn't fit what the format can store.
        """
        columns = self._columns(chunk, added, codes)
        header = b""
        if self._dtype is None:
            self._dtype = np.dtype(
                [(name, self._column_dtype(values.dtype)) for name, values in columns.items()]
            )
            header = self._header(self._dtype)
        table = np.empty(len(chunk), dtype=self._dtype)
        for name, values in columns.items():
            self._check_exact(name, values, self._dtype[name])
            table[name] = values
        self._append(header + self._rows(table), len(chunk))

    def _columns(
        self, chunk: PointCloud, added: Columns, codes: Codes | None
    ) -> dict[str, AttributeArray]:
        """All columns, one value a point each, under names that are valid and not repeated."""
        columns: dict[str, AttributeArray] = dict(zip("xyz", chunk.xyz.T, strict=True))

        def add(name: str, values: AttributeArray) -> None:
            if values.ndim > 1:
                flat = values.reshape(len(values), -1)
                for index in range(flat.shape[1]):
                    add(f"{name}_{index}", flat[:, index])
                return
            wanted = unique = self._column_name(name)
            copy = 1
            while unique in columns:
                copy += 1
                unique = f"{wanted}_{copy}"
            columns[unique] = values

        for name, values in (*chunk.attributes.items(), *added.items()):
            add(name, values)
        if codes is not None:
            add(LABEL if LABEL not in columns else PREDICTED_LABEL, codes.astype(np.int32))
        return columns

    def _check_exact(self, name: str, values: AttributeArray, stored: np.dtype[Any]) -> None:
        """Refuse integers that turn into other numbers in the format's floats."""
        if values.dtype.kind not in "iu" or stored.kind != "f" or not values.size:
            return
        if max(int(values.max()), -int(values.min())) > _LARGEST_EXACT_INTEGER:
            raise WriteError(
                f"{self._path}: column {name!r} holds integers beyond 2^53, which this format "
                "can't store exactly; write .pcd or .csv"
            )
