"""What a LAZ file claims of its compressed points, checked before lazrs believes it.

lazrs (laz-rs) sizes buffers by numbers from the file: the length of the chunk table, the chunk
size, the byte counts of the chunks. All of them are compared with the header and the file's size
first. lazrs runs in a process of its own all the same (:mod:`bushseg.io.laz_process`).

Source: the LASzip format (LAZ Specification 1.4 R1, ASPRS / rapidlasso).
"""

import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import lazrs
import numpy as np
from numpy.typing import NDArray

from bushseg.errors import BushsegError, ReadError
from bushseg.io.las_header import RECORD_SIZES, LasHeader
from bushseg.io.laz_process import LazProcess

LASZIP_RECORD = ("laszip encoded", 22204)
_VLR = struct.Struct("<HHBBHIIqqH")
_ITEM = struct.Struct("<HHH")
_CHUNK_SIZE_AT = 12
_VARIABLE_CHUNKS = 0xFFFFFFFF
_ONE_CHUNK = 0xFFFFFFFE  # Any size that isn't variable: lazrs panics over an unchunked 0.
_UNCHUNKED, _LAYERED = 1, 3
_BYTE_ITEMS = (0, 14)
# The items of each point format's record, extra bytes aside, and how many layers an item makes.
_ITEMS = (
    *((6,), (6, 7), (6, 8), (6, 7, 8), (6, 7, 9), (6, 7, 8, 9)),
    *((10,), (10, 11), (10, 12), (10, 13), (10, 12, 13)),
)
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}


@dataclass(frozen=True, slots=True)
class LazBody:
    """Where the compressed points are, checked against the file.

    Attributes:
        vlr: The LASzip VLR's payload, its chunk size in the words lazrs understands.
        chunks: Points and compressed bytes of each chunk, shape (M, 2), int64; None if all points
            are one stream.
        num_layers: Layers of each chunk; 0 where the chunks are not layered.
        num_bytes: From the points' begin to the file's end.
    """

    vlr: bytes
    chunks: NDArray[np.int64] | None
    num_layers: int
    num_bytes: int

    @property
    def one_chunk(self) -> bytes:
        """The payload of a file that holds a single chunk, of whatever size."""
        return _with_chunk_size(self.vlr, _ONE_CHUNK)


def inspect_laz(
    path: Path, file: BinaryIO, header: LasHeader, size: int, process: LazProcess
) -> LazBody:
    """Check all that sizes an allocation while decompressing, but for the layers.

    Raises:
        ReadError: The LASzip VLR is missing or contradicts the header, or the chunk table
            contradicts the number of points or the file's size.
    """
    record = next((vlr for vlr in header.vlrs if vlr.key == LASZIP_RECORD), None)
    if record is None:
        raise ReadError(path, "compressed points without a LASzip VLR", "one; it can't be decoded")
    payload = record.payload(file)
    compressor, chunk_size, num_layers = _parse_vlr(path, header, payload)
    if compressor == _UNCHUNKED:
        return LazBody(_with_chunk_size(payload, _ONE_CHUNK), None, 0, size - header.point_offset)
    if chunk_size == 0:  # Some writers of COPC say so.
        chunk_size = _VARIABLE_CHUNKS
    payload = _with_chunk_size(payload, chunk_size)
    chunks = _read_chunk_table(path, file, header, size, payload, chunk_size, process)
    return LazBody(payload, chunks, num_layers, size - header.point_offset)


@contextmanager
def lazrs_errors(convert: Callable[[str], BushsegError]) -> Iterator[None]:
    """Turn what lazrs returns or panics with into a BushsegError of one line.

    A Rust panic arrives as a BaseException that pyo3 makes and doesn't export, so it is told by
    its name; KeyboardInterrupt and SystemExit pass.
    """
    try:
        yield
    except BaseException as error:
        if not isinstance(error, lazrs.LazrsError) and type(error).__name__ != "PanicException":
            raise
        raise convert(" ".join(str(error).split())) from error


def _parse_vlr(path: Path, header: LasHeader, payload: bytes) -> tuple[int, int, int]:
    """Compressor, chunk size and number of layers."""
    expected = "the one its point format needs; the header is damaged"
    if len(payload) < _VLR.size:
        raise ReadError(path, f"a LASzip VLR of {len(payload)} bytes", expected)
    compressor, coder, *_, chunk_size, _, _, num_items = _VLR.unpack_from(payload)
    if len(payload) < _VLR.size + num_items * _ITEM.size:
        raise ReadError(path, f"a LASzip VLR cut off before its {num_items} items", expected)
    items = [
        _ITEM.unpack_from(payload, _VLR.size + index * _ITEM.size) for index in range(num_items)
    ]
    known = tuple(kind for kind, _, _ in items if kind not in _BYTE_ITEMS)
    length = sum(item_size for _, item_size, _ in items)
    if known != _ITEMS[header.point_format] or length != header.record_length:
        raise ReadError(
            path,
            f"LASzip items {known} of {length} bytes",
            f"{_ITEMS[header.point_format]} of {header.record_length} bytes for point format "
            f"{header.point_format}; the header is damaged",
        )
    layered = header.point_format >= 6
    if coder != 0 or compressor not in ((_LAYERED,) if layered else (_UNCHUNKED, 2)):
        raise ReadError(path, f"LASzip compressor {compressor}, coder {coder}", expected)
    extra_bytes = header.record_length - RECORD_SIZES[header.point_format]
    num_layers = sum(_LAYERS[kind] for kind in known) + extra_bytes if layered else 0
    return compressor, chunk_size, num_layers


def _with_chunk_size(payload: bytes, chunk_size: int) -> bytes:
    end = _CHUNK_SIZE_AT + 4
    return payload[:_CHUNK_SIZE_AT] + struct.pack("<I", chunk_size) + payload[end:]


def _read_chunk_table(
    path: Path,
    file: BinaryIO,
    header: LasHeader,
    size: int,
    vlr: bytes,
    chunk_size: int,
    process: LazProcess,
) -> NDArray[np.int64]:
    start = header.point_offset
    table = _find_chunk_table(path, file, start, size)
    room = table - start - 8
    file.seek(table + 4)
    (num_chunks,) = struct.unpack("<I", file.read(4))
    variable = chunk_size == _VARIABLE_CHUNKS
    needed = -(-header.num_points // chunk_size)
    # LASzip may close a file with an empty chunk.
    plausible = num_chunks > 0 if variable else num_chunks in (needed, needed + 1)
    # Each chunk opens with one point as it is.
    if not plausible or (num_chunks - 1) * header.record_length > room:
        raise ReadError(
            path,
            f"a table of {num_chunks:,} LAZ chunks",
            f"one for {header.num_points:,} points in {room:,} bytes; the file is damaged",
        )
    request = {"table": table, "vlr": vlr.hex()}
    (answer,) = process.run(request, 16 * num_chunks)
    chunks = answer.view("<i8").reshape(-1, 2).astype(np.int64)
    if not variable:
        chunks = chunks[:needed]
        chunks[:, 0] = chunk_size
        chunks[-1, 0] = header.num_points - chunk_size * (needed - 1)
    if (chunks < 0).any() or (chunks > (header.num_points, size)).any():
        raise ReadError(path, "a LAZ chunk table that reaches beyond the file", "an undamaged one")
    chunks = chunks[chunks[:, 0] > 0]
    num_points, num_bytes = (int(total) for total in chunks.sum(axis=0))
    if num_points != header.num_points or num_bytes > room:
        raise ReadError(
            path,
            f"LAZ chunks of {num_points:,} points in {num_bytes:,} bytes",
            f"{header.num_points:,} points in at most {room:,} bytes; the file is damaged",
        )
    return chunks


def _find_chunk_table(path: Path, file: BinaryIO, start: int, size: int) -> int:
    """Position of the chunk table; a writer that couldn't seek leaves it in the last 8 bytes."""
    for place in (start, size - 8):
        file.seek(place)
        raw = file.read(8)
        if len(raw) == 8:
            (table,) = struct.unpack("<q", raw)
            if start + 8 <= table <= size - 8:
                return int(table)
    raise ReadError(
        path,
        f"no LAZ chunk table in {size:,} bytes",
        "one behind the points; the file was cut off, copy it again",
    )
