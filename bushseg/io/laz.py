"""Compressed points, group by group.

lazrs is given one group of chunks at a time from memory, each decompressed from its own bytes, in
parallel: what is wrong with one can't reach into another. Layered chunks (point formats 6 to 10)
declare the sizes of their layers, by which lazrs allocates; they are checked first. What it still
stumbles over is an error it returns or a Rust panic, and becomes a ReadError.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import lazrs
import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.io.las_header import LasHeader
from bushseg.io.laz_body import LazBody, lazrs_as_read_errors

_MAX_CHUNK_BYTES = 1 << 28  # Decompressed; a larger chunk is streamed instead.
_FLAGS_AT = 15  # in records of formats 6 to 10


def decompress(
    path: Path, file: BinaryIO, header: LasHeader, body: LazBody, size: int
) -> Iterator[NDArray[np.uint8]]:
    """Yield the raw bytes of at most `size` points at a time, in the file's order.

    Raises:
        ReadError: The compressed points are damaged.
    """
    limit = max(1, _MAX_CHUNK_BYTES // header.record_length)
    is_small = body.chunks is not None and body.chunks[:, 0].max() <= limit
    run = _decompress_chunks if is_small else _decompress_stream
    first = None
    with lazrs_as_read_errors(path):
        for raw in run(path, file, header, body, size):
            flags = raw[_FLAGS_AT :: header.record_length]
            first = flags[0] if first is None else first
            if garbles_waveforms(header.point_format, flags, first):
                raise ReadError(
                    path,
                    "compressed waveform packets of several scanner channels",
                    "LAS, for lazrs garbles them; decompress the file with LASzip first",
                )
            yield raw


def garbles_waveforms(point_format: int, flags: NDArray[np.uint8], first: np.uint8) -> bool:
    """Whether lazrs loses bits of these points.

    lazrs 0.8.2 doesn't give back the waveform packets of point formats 9 and 10 that it was given
    where the scanner channel changes within a chunk; all else survives.

    Args:
        point_format: 0 to 10.
        flags: The points' classification flags, whose bits 4 and 5 are the scanner channel.
        first: The flags of the file's first point.
    """
    return point_format in (9, 10) and bool(((flags ^ first) & 0x30).any())


def _decompress_chunks(
    path: Path, file: BinaryIO, header: LasHeader, body: LazBody, size: int
) -> Iterator[NDArray[np.uint8]]:
    """Decompress groups of whole chunks in parallel; a chunk larger than `size` is cut."""
    assert body.chunks is not None
    position = header.point_offset + 8
    for entries in _group_chunks(body.chunks, size):
        file.seek(position)
        data = file.read(sum(length for _, length in entries))
        at = 0
        for entry in entries:
            _check_chunk(path, header, body, data[at : at + _head_bytes(header, body)], entry)
            at += entry[1]
        raw = np.empty(sum(points for points, _ in entries) * header.record_length, np.uint8)
        lazrs.decompress_points_with_chunk_table(data, body.vlr, raw, entries)
        position += len(data)
        step = size * header.record_length
        for begin in range(0, len(raw), step):
            yield raw[begin : begin + step]


def _decompress_stream(
    path: Path, file: BinaryIO, header: LasHeader, body: LazBody, size: int
) -> Iterator[NDArray[np.uint8]]:
    """Decompress point after point, whatever the chunks: slower, in bounded memory."""
    position = header.point_offset + 8
    for entry in [] if body.chunks is None else body.chunks.tolist():
        file.seek(position)
        _check_chunk(path, header, body, file.read(_head_bytes(header, body)), entry)
        position += entry[1]
    with path.open("rb") as stream:  # The decompressor reads ahead: it needs a file of its own.
        stream.seek(header.point_offset)
        decompressor = lazrs.LasZipDecompressor(stream, body.vlr)
        for begin in range(0, header.num_points, size):
            num_points = min(size, header.num_points - begin)
            raw = np.empty(num_points * header.record_length, np.uint8)
            decompressor.decompress_many(raw)
            yield raw


def _group_chunks(chunks: NDArray[np.int64], size: int) -> Iterator[list[tuple[int, int]]]:
    """Consecutive chunks of at most `size` points together, at least one at a time."""
    group: list[tuple[int, int]] = []
    num_points = 0
    for points, length in chunks.tolist():
        if group and num_points + points > size:
            yield group
            group, num_points = [], 0
        group.append((points, length))
        num_points += points
    yield group


def _head_bytes(header: LasHeader, body: LazBody) -> int:
    """What a chunk opens with: a point as it is; if layered, the point count and layer sizes."""
    return header.record_length + (4 + 4 * body.num_layers if body.num_layers else 0)


def _check_chunk(
    path: Path, header: LasHeader, body: LazBody, head: bytes, entry: tuple[int, int]
) -> None:
    points, length = entry
    needed = _head_bytes(header, body)
    if length >= needed and body.num_layers and len(head) == needed:
        count, *layers = struct.unpack_from(f"<{1 + body.num_layers}I", head, header.record_length)
        needed = needed + sum(layers) if count == points else length + 1
    if length < needed or len(head) < _head_bytes(header, body):
        raise ReadError(
            path,
            f"a LAZ chunk of {length:,} bytes whose parts don't fit it",
            f"its {points:,} points and their layers in it; the file is damaged, copy it again",
        )
