"""Points in text: Semantic3D's `.txt` (+ `.labels`), `.xyz`, and `.csv` with a header.

Columns are named by a header line, by a comment that names as many columns as there are, or else
by their number (:data:`COLUMN_NAMES`). Values are float64, but for class codes written as integers,
which are int64: other integers beyond 2^53 are not exact.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.errors import ReadError
from bushseg.io.ascii import count_rows, read_rows
from bushseg.io.base import ScanInfo, ScanReader, ScanWriter
from bushseg.io.codes import TEXT_DTYPE
from bushseg.io.sniff import check_file
from bushseg.io.stream import Body, Table
from bushseg.io.table import (
    LABEL,
    Coordinates,
    TableReader,
    TableWriter,
    attribute_dtypes,
    find_coordinates,
    find_label,
)

LABELS_SUFFIX = ".labels"
COLUMN_NAMES = {
    3: ("x", "y", "z"),
    4: ("x", "y", "z", "intensity"),
    6: ("x", "y", "z", "red", "green", "blue"),
    7: ("x", "y", "z", "intensity", "red", "green", "blue"),
}
"""What columns mean where the file doesn't say, by their number; 7 is Semantic3D's layout."""

_HEAD_BYTES = 1 << 16
_BATCH_ROWS = 1 << 16
_LONE_RETURN = re.compile(rb"\r(?!\n|\Z)")  # as old Macs end lines; the head may end within \r\n
_INTEGER = re.compile(r"[+-]?\d{1,19}")  # Python refuses to parse thousands of digits


@dataclass(frozen=True, slots=True)
class _Layout:
    body: Body
    coordinates: Coordinates
    stated_count: int | None  # some programs put the number of points on a line of its own first


class TextReader(TableReader):
    """An open text file, with its labels if it has any."""

    def __init__(self, info: ScanInfo, layout: _Layout, labels: Body | None, label: str) -> None:
        super().__init__(info, layout.coordinates)
        self._body = layout.body
        self._labels = labels
        self._label = label

    def _tables(self, size: int) -> Iterator[Table]:
        tables = read_rows(self._body, size)
        if self._labels is None:
            yield from tables
            return
        blocks = read_rows(self._labels, size)
        codes = np.empty(0, dtype=TEXT_DTYPE)
        dtype = np.dtype([*self._body.dtype.descr, (self._label, TEXT_DTYPE["label"])])
        for table in tables:
            while len(codes) < len(table):
                codes = np.concatenate([codes, self._next_labels(blocks)])
            labelled = np.empty(len(table), dtype=dtype)
            for name in table.dtype.names or ():
                labelled[name] = table[name]
            labelled[self._label] = codes["label"][: len(table)]
            codes = codes[len(table) :]
            yield labelled

    def _next_labels(self, blocks: Iterator[Table]) -> Table:
        try:
            return next(blocks)
        except StopIteration:
            raise ReadError(
                self.info.path.with_suffix(LABELS_SUFFIX), "too few labels", "one a point"
            ) from None


def open_text(path: Path) -> ScanReader:
    """Open a text file; the lines are counted now, once.

    Class codes may stand beside it in a file of the same stem and the suffix `.labels`.

    Raises:
        ReadError: The first lines aren't a table of numbers with x, y and z, there are no points,
            or the labels are of another number.
    """
    layout = _sniff(path)
    num_points = count_rows(path, layout.body.offset)
    if layout.stated_count not in (None, num_points):
        raise ReadError(
            path, f"{num_points:,} points", f"{layout.stated_count:,}, as its first line says"
        )
    attributes = attribute_dtypes(layout.body.dtype, layout.coordinates)
    label = find_label(attributes)
    labels_path = find_labels(path)
    labels = None
    if labels_path is not None:
        check_file(labels_path)
        labels = Body(labels_path, 0, 1, TEXT_DTYPE)
        num_labels = count_rows(labels_path)
        if num_labels != num_points:
            raise ReadError(
                labels_path,
                f"{num_labels:,} labels",
                f"{num_points:,}, one a point of {path.name}",
            )
        label = LABEL if LABEL not in attributes else f"{LABEL}_of_{labels_path.name}"
        attributes[label] = TEXT_DTYPE["label"]
    info = ScanInfo(
        path=path,
        format="text, "
        + {",": "comma", ";": "semicolon", None: "space"}[layout.body.delimiter]
        + "-separated",
        num_points=num_points,
        attributes=attributes,
        label_attribute=label,
    )
    return TextReader(info, layout, labels, label or LABEL)


def find_labels(path: Path) -> Path | None:
    """The `.labels` file beside a text file, if there is one."""
    beside = path.with_suffix(LABELS_SUFFIX)
    return beside if beside.exists() else None


def is_points(path: Path) -> bool:
    """Whether a text file begins like a table of points; notes and metrics don't."""
    try:
        check_file(path)
        _sniff(path)
    except ReadError:
        return False
    return True


def _sniff(path: Path) -> _Layout:
    """Find the first row of numbers, and what its columns are, from the head of the file."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if b"\0" in head:
        raise ReadError(path, "binary content (or UTF-16 text)", "rows of numbers in plain text")
    if _LONE_RETURN.search(head):
        raise ReadError(
            path,
            "lines that end in a carriage return alone",
            "line feeds; convert it (`tr '\\r' '\\n'`)",
        )
    comment: list[str] = []
    header: list[str] = []
    stated_count = None
    offset = 0
    for number, raw in enumerate(head.splitlines(keepends=True), start=1):
        text = raw.decode("utf-8-sig", errors="replace").strip()
        delimiter = next((mark for mark in ",;" if mark in text), None)
        words = [word.strip().strip('"') for word in text.lstrip("#/").strip().split(delimiter)]
        if text.startswith(("#", "//")):
            comment = words
        elif text and not all(_is_number(word) for word in words):
            if header:
                raise ReadError(path, f"line {number} is {text[:60]!r}", "numbers below the header")
            header = words
        elif len(words) == 1 and _INTEGER.fullmatch(words[0]) and stated_count is None:
            stated_count = int(words[0])
        elif text:
            names = _column_names(path, len(words), header, comment)
            return _layout(path, offset, number, names, words, delimiter, stated_count)
        offset += len(raw)
    found = f"{header[0][:40]!r} at its beginning" if header else "no points"
    raise ReadError(path, found, "rows of numbers: x y z and what follows them")


def _column_names(path: Path, num_columns: int, header: list[str], comment: list[str]) -> list[str]:
    """Names of all columns, each given and none repeated."""
    if header and len(header) != num_columns:
        raise ReadError(
            path, f"{len(header)} column names over rows of {num_columns} numbers", "as many"
        )
    names = header
    if not names and len(comment) == num_columns and find_coordinates(comment):
        names = comment
    if not names:
        usual = COLUMN_NAMES.get(num_columns, COLUMN_NAMES[3])
        names = [*usual, *(f"c{index}" for index in range(len(usual), num_columns))]
    unique: list[str] = []
    for index, name in enumerate(names[:num_columns]):
        unique.append(f"{name}_{index}" if name in unique or not name else name)
    return unique


def _layout(
    path: Path,
    offset: int,
    line: int,
    names: list[str],
    first_row: list[str],
    delimiter: str | None,
    stated_count: int | None,
) -> _Layout:
    coordinates = find_coordinates(names)
    if coordinates is None or len(first_row) < 3:
        raise ReadError(path, f"the columns {', '.join(names)[:200]}", "x, y and z among them")
    label = find_label(names)
    # Codes written as 2.0 stay floats, as they would in a PLY file that has them so.
    dtype = np.dtype(
        [
            (name, "<i8" if name == label and _INTEGER.fullmatch(word) else "<f8")
            for name, word in zip(names, first_row, strict=True)
        ]
    )
    return _Layout(Body(path, offset, line, dtype, delimiter), coordinates, stated_count)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


class TextWriter(TableWriter):
    """Writes a row of numbers a line, each with as many digits as give it back exactly.

    Args:
        path: The file to write.
        source: The scan being copied.
        separator: Between values.
        prefix: Before the names on the first line.
    """

    def __init__(self, path: Path, source: ScanReader, separator: str, prefix: str) -> None:
        super().__init__(path, source)
        self._separator = separator
        self._prefix = prefix

    def _column_name(self, name: str) -> str:
        return super()._column_name(re.sub(r'[,;"#]', "_", name))

    def _header(self, dtype: np.dtype[Any]) -> bytes:
        return (self._prefix + self._separator.join(dtype.names or ()) + "\n").encode("ascii")

    def _rows(self, table: Table) -> bytes:
        # In batches: as Python objects, numbers take several times the space.
        starts = range(0, len(table), _BATCH_ROWS)
        return b"".join(self._lines(table[start : start + _BATCH_ROWS]) for start in starts)

    def _lines(self, table: Table) -> bytes:
        columns = []
        for name in table.dtype.names or ():
            values = table[name].tolist()
            if table.dtype[name] == np.float32:
                # 9 digits give any float32 back, and spare the reader 0.10000000149011612.
                values = [float(f"{value:.9g}") for value in values]
            columns.append(map(repr, values))
        lines = (self._separator.join(row) + "\n" for row in zip(*columns, strict=True))
        return "".join(lines).encode("ascii")


def create_csv(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> ScanWriter:  # noqa: ARG001
    """Create a comma-separated file whose first line names the columns."""
    return TextWriter(path, source, separator=",", prefix="")


def create_txt(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> ScanWriter:  # noqa: ARG001
    """Create a space-separated file whose first line, a comment, names the columns."""
    return TextWriter(path, source, separator=" ", prefix="# ")
