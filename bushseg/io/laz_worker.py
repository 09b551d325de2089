"""A process that decompresses LAZ, and nothing else: what is asked of it, and the answers.

    python -I -S laz_worker.py FOLDER      # where lazrs is

lazrs reads and writes beyond its tables where compressed bytes are damaged, and aborts where a size
is absurd: no check beforehand finds all of it, and no handler survives it. So it runs here. A
request is a line of JSON on standard input; its answer are frames on standard output: a length,
then so many bytes. Length 0 ends an answer, -1 announces the length and the text of a refusal.

Imports nothing of bushseg's, so that it starts at once.
"""

import io
import itertools
import json
import os
import struct
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

LENGTH = struct.Struct("<q")
_MOST = 2**63 - 1


class RefusalError(Exception):
    """The compressed points contradict themselves; two texts, what was found and what expected."""


@dataclass(frozen=True)
class Points:
    """A request for all points.

    Attributes:
        path: The file.
        start: Where the first chunk begins.
        chunks: Points and bytes of each.
        vlr: The LASzip VLR, in hexadecimal.
        record_length: Bytes a point.
        num_layers: Layers of each chunk; 0 where they are not layered.
        size: Points in a frame, at most.
        streamed: Whether a chunk may be too large to be decompressed at once; `vlr` then is that of
            a file of one chunk.
        has_table: Whether lazrs looks for a chunk table.
    """

    path: str
    start: int
    chunks: list[tuple[int, int]]
    vlr: str
    record_length: int
    num_layers: int
    size: int
    streamed: bool
    has_table: bool = True


def answer(request: dict[str, Any]) -> Iterator[bytes | bytearray | memoryview]:
    """Do what is asked: the key "table" wants a chunk table, any other request is for points.

    Raises:
        RefusalError: The file contradicts itself.
    """
    with open(request["path"], "rb") as file:  # noqa: PTH123 - pathlib is slow to import
        if "table" in request:
            yield _read_table(file, request["table"], bytes.fromhex(request["vlr"]))
        else:
            points = Points(**request)
            yield from (_stream if points.streamed else _decompress)(file, points)


def _read_table(file: BinaryIO, position: int, vlr: bytes) -> bytes:
    """Points and bytes of each chunk, int64; a negative count comes as the largest there is."""
    import lazrs

    file.seek(position)
    entries = lazrs.read_chunk_table_only(file, lazrs.LazVlr(vlr))
    numbers = [min(number, _MOST) for entry in entries for number in entry]
    return struct.pack(f"<{len(numbers)}q", *numbers)


def _decompress(file: BinaryIO, points: Points) -> Iterator[memoryview]:
    """Decompress groups of whole chunks, each on all cores; a chunk larger than a frame is cut."""
    import lazrs

    vlr, at = bytes.fromhex(points.vlr), points.start
    for group in _group(points):
        file.seek(at)
        data = file.read(sum(length for _, length in group))
        inside = 0
        for num_points, length in group:
            _check_chunk(Window(io.BytesIO(data), inside, length), points, num_points, length)
            inside += length
        raw = bytearray(sum(num_points for num_points, _ in group) * points.record_length)
        lazrs.decompress_points_with_chunk_table(data, vlr, raw, group)
        at += len(data)
        step = points.size * points.record_length
        yield from (memoryview(raw)[begin : begin + step] for begin in range(0, len(raw), step))


def _stream(file: BinaryIO, points: Points) -> Iterator[bytearray]:
    """Decompress point after point, whatever the chunks: slower, in bounded memory.

    Each chunk is shown to lazrs as a file that holds nothing else: it would otherwise go on where
    the last one left off, whatever the chunk table says.
    """
    import lazrs

    vlr, at = bytes.fromhex(points.vlr), points.start
    for num_points, length in points.chunks:
        _check_chunk(Window(file, at, length), points, num_points, length)
        before, behind = b"", b""
        if points.has_table:  # where it is, and one without entries
            before, behind = LENGTH.pack(LENGTH.size + length), bytes(8)
        decompressor = lazrs.LasZipDecompressor(Window(file, at, length, before, behind), vlr)
        for begin in range(0, num_points, points.size):
            raw = bytearray(min(points.size, num_points - begin) * points.record_length)
            decompressor.decompress_many(raw)
            yield raw
        at += length


def _group(points: Points) -> Iterator[list[tuple[int, int]]]:
    """Consecutive chunks of at most a frame's points together, at least one at a time."""
    group: list[tuple[int, int]] = []
    total = 0
    for num_points, length in points.chunks:
        if group and total + num_points > points.size:
            yield group
            group, total = [], 0
        group.append((num_points, length))
        total += num_points
    yield group


def _check_chunk(chunk: "Window", points: Points, num_points: int, length: int) -> None:
    """Hold a chunk's parts against its length.

    A chunk opens with a point as it is. If layered, the number of points and the size of each layer
    follow, and then the layers.
    """
    size = points.record_length + (4 + 4 * points.num_layers if points.num_layers else 0)
    head = chunk.read(size)
    fits = len(head) == size
    if fits and points.num_layers:
        layout = f"<{1 + points.num_layers}I"
        count, *layers = struct.unpack_from(layout, head, points.record_length)
        fits = count == num_points and size + sum(layers) <= length
    if not fits:
        raise RefusalError(
            f"a LAZ chunk of {length:,} bytes whose parts don't fit it",
            f"its {num_points:,} points and their layers in it; the file is damaged, copy it again",
        )


class Window(io.RawIOBase):
    """A stretch of a file as a file of its own, between other bytes.

    Args:
        file: The file.
        start: Where the stretch begins.
        length: How long it is, at most.
        before: What stands before it.
        behind: What stands behind it.
    """

    def __init__(
        self, file: BinaryIO, start: int, length: int, before: bytes = b"", behind: bytes = b""
    ) -> None:
        self._file, self._start = file, start
        self._before, self._behind = before, behind
        self._ends = tuple(itertools.accumulate((len(before), length, len(behind))))
        self._position = 0

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move; a position before the beginning is the beginning."""
        self._position = max(0, offset + (0, self._position, self._ends[-1])[whence])
        return self._position

    def read(self, size: int = -1) -> bytes:
        """Read on: less than asked for where a part ends, nothing behind the last."""
        begin, middle, end = self._ends
        at = self._position
        size = min(max(0, end - at), size if size is not None and size >= 0 else end)
        if at < begin:
            data = self._before[at : at + size]
        elif at < middle:
            self._file.seek(self._start + at - begin)
            data = self._file.read(min(size, middle - at))
        else:
            data = self._behind[at - middle :][:size]
        self._position += len(data)
        return data

    def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
        """Read into a buffer; how many bytes."""
        data = self.read(len(buffer))
        buffer[: len(data)] = data
        return len(data)


def serve(lines: BinaryIO, write: Callable[[bytes | memoryview], object]) -> None:
    """Answer request after request, until there are no more."""
    for line in lines:
        try:
            for block in answer(json.loads(line)):
                write(LENGTH.pack(len(block)))
                write(memoryview(block))
        except RefusalError as error:
            text = json.dumps(error.args)
        except Exception as error:
            text = json.dumps(" ".join(str(error).split()) or type(error).__name__)
        except BaseException as error:  # a Rust panic, which pyo3 makes no Exception of
            if type(error).__name__ != "PanicException":
                raise
            text = json.dumps(" ".join(str(error).split()))
        else:
            write(LENGTH.pack(0))
            continue
        write(LENGTH.pack(-1) + LENGTH.pack(len(text)) + text.encode())


def _write(data: bytes | memoryview) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(1, view) :]


if __name__ == "__main__":
    sys.path.append(sys.argv[1])
    try:
        serve(sys.stdin.buffer, _write)
    except (BrokenPipeError, KeyboardInterrupt):
        os._exit(1)
