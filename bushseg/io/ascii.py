"""Rows of numbers in text, in bounded memory: the body of text, ASCII PLY and ASCII PCD files.

NumPy's `loadtxt` with a structured dtype was the fastest parser measured that needs no further
dependency (7 columns: 1.8 M rows/s, against 1.3 M for `fromstring` and 1.0 M for a plain 2-D
`loadtxt`), and it checks each value against its column's type. It names the wrong line in some of
its errors, so that line is found here.
"""

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bushseg.errors import ReadError
from bushseg.io.stream import Body, Table

BLOCK_BYTES = 1 << 24
_MAX_LINE_BYTES = 1 << 16

# A line that begins so may be blank or a comment; few files have any, so look before substituting.
_SUSPECT = re.compile(rb"\n[\s#/]")
_NOT_A_ROW = re.compile(rb"^[^\S\n]*(?:(?:#|//)[^\n]*)?(?:\n|\Z)", re.MULTILINE)


def count_rows(path: Path, offset: int = 0) -> int:
    """Count the lines after `offset` that are neither blank nor comments.

    Raises:
        ReadError: A line is too long to be a row of numbers.
    """
    return sum(_num_lines(_rows_only(block)) for block in _blocks(path, offset))


def read_rows(body: Body, size: int, limit: int | None = None) -> Iterator[Table]:
    """Yield the rows in order, at most `size` at a time; blank lines and comments are passed over.

    Args:
        body: What to read.
        size: Rows per array, at most.
        limit: Stop after so many rows, whatever follows them; None for all.

    Raises:
        ReadError: A line doesn't hold the expected numbers; says which.
    """
    line = body.line
    remaining = limit
    for block in _blocks(body.path, body.offset):
        rows = _rows_only(block)
        if remaining is not None:
            if _num_lines(rows) > remaining:
                rows = b"\n".join(rows.split(b"\n", remaining)[:remaining])
            remaining -= _num_lines(rows)
        if rows:
            try:
                table = _parse(rows, body)
            except ValueError as error:
                raise _malformed(body, block, line, rows) from error
            yield from (table[start : start + size] for start in range(0, len(table), size))
        if remaining == 0:
            return
        line += block.count(b"\n")


def skip_lines(path: Path, offset: int, count: int) -> int:
    """Return the offset after `count` further lines, or the end of the file if it comes first."""
    with path.open("rb") as file:
        file.seek(offset)
        for _ in range(count):
            if not file.readline(_MAX_LINE_BYTES):
                break
        return file.tell()


def _blocks(path: Path, offset: int) -> Iterator[bytes]:
    """Yield the file from `offset` on, in blocks of whole lines."""
    rest = b""
    with path.open("rb") as file:
        file.seek(offset)
        while block := file.read(BLOCK_BYTES):
            end = block.rfind(b"\n") + 1
            if len(block) - end > _MAX_LINE_BYTES:
                raise ReadError(
                    path, f"a line longer than {_MAX_LINE_BYTES:,} bytes", "a row of numbers a line"
                )
            if end:
                yield rest + block[:end]
                rest = b""
            rest += block[end:]
    if rest:
        yield rest


def _rows_only(block: bytes) -> bytes:
    if _SUSPECT.search(block) or block[:1] in b" \t\r\n\v\f#/":
        return _NOT_A_ROW.sub(b"", block)
    return block


def _num_lines(rows: bytes) -> int:
    return rows.count(b"\n") + (bool(rows) and not rows.endswith(b"\n"))


def _parse(rows: bytes, body: Body) -> Table:
    table: Table = np.loadtxt(
        io.BytesIO(rows),
        dtype=body.dtype,
        comments=None,
        delimiter=body.delimiter,
        ndmin=1,
        encoding="ascii",
    )
    return table


def _malformed(body: Body, block: bytes, line: int, rows: bytes) -> ReadError:
    """Find the first line of a block that doesn't parse, by bisection."""
    lines = rows.rstrip(b"\n").split(b"\n")
    low, high = 0, len(lines)
    while high - low > 1:
        middle = (low + high) // 2
        try:
            _parse(b"\n".join(lines[low:middle]), body)
        except ValueError:
            high = middle
        else:
            low = middle
    is_row = (bool(_rows_only(raw)) for raw in block.split(b"\n"))
    number = line + [index for index, kept in enumerate(is_row) if kept][low]
    text = lines[low][:60].decode("latin-1")
    num_columns = sum(int(np.prod(body.dtype[name].shape)) for name in body.dtype.names or ())
    types = sorted({body.dtype[name].base.name for name in body.dtype.names or ()})
    return ReadError(
        body.path,
        f"line {number:,} is {text!r}",
        f"{num_columns} values ({', '.join(types)}); repair or remove the line",
    )
