"""Compressed points, group by group.

A process of its own decompresses them (:mod:`bushseg.io.laz_process`), given one group of chunks at
a time, each from its own bytes: what is wrong with one can't reach into another. It is a group
ahead while points are used here.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.io.las_header import LasHeader
from bushseg.io.laz_body import LazBody
from bushseg.io.laz_process import LazProcess

_MAX_CHUNK_BYTES = 1 << 28  # Decompressed; a larger chunk is streamed instead.
_FLAGS_AT = 15  # in records of formats 6 to 10


def decompress(
    path: Path, process: LazProcess, header: LasHeader, body: LazBody, size: int
) -> Iterator[NDArray[np.uint8]]:
    """Yield the raw bytes of at most `size` points at a time, in the file's order.

    Raises:
        ReadError: The compressed points are damaged.
    """
    first = None
    for raw in process.run(_request(header, body, size), size * header.record_length):
        if len(raw) % header.record_length:
            raise ReadError(path, "compressed points that decode to a part of one", "whole points")
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


def _request(header: LasHeader, body: LazBody, size: int) -> dict[str, Any]:
    """All points, in the words of :class:`bushseg.io.laz_worker.Points`."""
    limit = max(1, _MAX_CHUNK_BYTES // header.record_length)
    has_table = body.chunks is not None
    chunks = [(header.num_points, body.num_bytes)]
    if body.chunks is not None:
        chunks = body.chunks.tolist()
    streamed = not has_table or max(num_points for num_points, _ in chunks) > limit
    return {
        "start": header.point_offset + (8 if has_table else 0),
        "chunks": chunks,
        "vlr": (body.one_chunk if streamed else body.vlr).hex(),
        "record_length": header.record_length,
        "num_layers": body.num_layers,
        "size": size,
        "streamed": streamed,
        "has_table": has_table,
    }
