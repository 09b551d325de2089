"""LAS to LAS: every byte that isn't labelled stays what it was."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.errors import WriteError
from bushseg.io.base import Codes, Columns, ScanWriter
from bushseg.io.las_points import EXTRA_BYTES_RECORD, PointLayout, Records
from bushseg.io.las_reader import LasReader
from bushseg.io.las_sink import Evlr, LasSink, pack_vlr
from bushseg.io.laz_body import LASZIP_RECORD
from bushseg.parallel import for_chunks
from bushseg.points import PointCloud

_CHUNK = 65_536  # records a thread takes at a time


class LasWriter(ScanWriter):
    """A copy of a LAS or LAZ scan with new class codes and extra dimensions.

    Kept bit for bit: all fields of all points, in order; the header but for counts, bounds and
    offsets, which are set to what the points are; VLRs and EVLRs, waveforms included; bytes behind
    the header's and before the points' place. An extra dimension that has the name and dtype of an
    added column (a scan labelled before) is overwritten; otherwise a name that is taken gets the
    suffix _2, _3, ... A COPC index doesn't survive: it describes chunks that are no longer there.

    Args:
        path: The file to write; `.laz` is compressed.
        source: The scan the chunks come from.
        added: Name to dtype of each added column.

    Raises:
        WriteError: The file can't be written, or a dtype has no LAS type.
    """

    def __init__(self, path: Path, source: LasReader, added: Mapping[str, np.dtype[Any]]) -> None:
        layout, self._fields = add_columns(source.layout, added)
        self._layout = layout
        self.has_legacy_codes = layout.point_format < 6
        self._header = source.header
        self._source = source.info.path.open("rb")
        descriptors = None if layout is source.layout else b"".join(layout.described())
        self._replaces_descriptors = descriptors is not None
        try:
            vlrs = self._copied_vlrs(descriptors)
            self._source.seek(self._header.vlr_end)
            gap = self._source.read(self._header.point_offset - self._header.vlr_end)
            self._sink = LasSink(path, self._header.raw, layout, vlrs, gap)
        except BaseException:
            self._source.close()
            raise

    def write(self, chunk: PointCloud, added: Columns, codes: Codes | None) -> None:
        """Write one chunk of the source.

        Raises:
            WriteError: The disk is full, or a class code is negative or doesn't fit the point
                format's field.
        """
        records = np.empty(len(chunk), self._layout.dtype)
        # The record only grows at its end.
        old = chunk.record.view(np.uint8).reshape(len(chunk), -1)
        room = records.view(np.uint8).reshape(len(chunk), -1)[:, : old.shape[1]]

        def fill(start: int, stop: int) -> None:
            rows = slice(start, stop)
            room[rows] = old[rows]
            for name, field in self._fields.items():
                records[field][rows] = added[name][rows]
            if codes is not None:
                set_classification(records[rows], codes[rows], self._layout.point_format)

        for_chunks(fill, len(chunk), _CHUNK)
        self._sink.append(records)

    def close(self) -> None:
        """Write the EVLRs, the counts and the bounds, and release the file."""
        header = self._header
        evlrs = [
            Evlr(record.head, record.offset, record == header.waveform)
            for record in header.evlrs
            if record.user_id != "copc"
            and not (self._replaces_descriptors and record.key == EXTRA_BYTES_RECORD)
        ]
        if header.waveform is not None and not any(evlr.is_waveform for evlr in evlrs):
            # LAS 1.3 has no list of EVLRs, only the place of this one.
            evlrs.append(Evlr(header.waveform.head, header.waveform.offset, is_waveform=True))
        try:
            self._sink.finish(evlrs, self._source)
        finally:
            self.abort()

    def abort(self) -> None:
        """Release the file as it stands, and the source."""
        self._source.close()
        self._sink.close()

    def _copied_vlrs(self, descriptors: bytes | None) -> list[bytes]:
        """Whole VLRs; the first that describes extra bytes makes room for new descriptors."""
        vlrs = []
        for record in self._header.vlrs:
            if record.key == LASZIP_RECORD or record.user_id == "copc":
                continue
            payload = record.payload(self._source)
            head = record.head
            if descriptors is not None and record.key == EXTRA_BYTES_RECORD:
                payload, descriptors = descriptors, None
                head = head[:20] + len(payload).to_bytes(2, "little") + head[22:]
            vlrs.append(head + payload)
        if descriptors is not None:
            vlrs.append(pack_vlr(EXTRA_BYTES_RECORD, "Extra bytes", descriptors))
        return vlrs


def add_columns(
    layout: PointLayout, added: Mapping[str, np.dtype[Any]]
) -> tuple[PointLayout, dict[str, str]]:
    """Make room for every added column.

    Returns:
        The layout (the same object if nothing had to be added) and, for each column, the name of
        its field.

    Raises:
        WriteError: LAS has no type for a column, or no room.
    """
    fields: dict[str, str] = {}
    for name, dtype in added.items():
        layout, fields[name] = layout.with_added(name, dtype, reserved=tuple(fields.values()))
    return layout, fields


def set_classification(records: Records, codes: Codes, point_format: int) -> None:
    """Set the class codes of records in place; the flags beside them stay.

    Args:
        records: Point records, shape (N,).
        codes: Codes, shape (N,), any integer dtype.
        point_format: Formats 0 to 5 have 5 bits for a code, 6 to 10 a byte.

    Raises:
        WriteError: A code doesn't fit.
    """
    largest = 31 if point_format < 6 else 255
    wrong = (codes < 0) | (codes > largest)
    if wrong.any():
        raise WriteError(
            f"class code {codes[wrong][0]} in point format {point_format}, which holds 0 to "
            f"{largest}; map the classes to codes that fit"
        )
    if point_format < 6:
        flags = records["raw_classification"] & 0xE0
        records["raw_classification"] = flags | codes.astype(np.uint8)
    else:
        records["classification"] = codes
