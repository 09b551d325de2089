"""The LAS header and its records, parsed and checked before anything is allocated by them.

Every count and offset a LAS file declares is compared with the size of the file here, so that the
readers behind never see a header that promises more than there is. The header's bytes are kept as
they stand: the writer copies them and changes only what must change.

Layouts follow the LAS 1.4 specification (ASPRS, R15), whose older versions are prefixes of it.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError

# signature to version, identifiers, date, sizes, point format, legacy counts, scales to bounds
HEADER_1_0 = struct.Struct("<4sHH16sBB32s32sHHHIIBHI5I12d")
WAVEFORM_START = struct.Struct("<Q")  # at 227, since LAS 1.3
HEADER_1_4 = struct.Struct("<QIQ15Q")  # at 235: first EVLR, EVLRs, points, points by return
WAVEFORM_AT = 227
HEADER_1_4_AT = 235
HEADER_SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}  # by minor version
VLR_HEAD = struct.Struct("<H16sHH32s")
EVLR_HEAD = struct.Struct("<H16sHQ32s")
# X .. point source id (0-5) or gps time (6-10), and what each format adds
RECORD_SIZES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
COMPRESSED_BIT = 0x80
WAVEFORM_INTERNAL_BIT = 0x02
WAVEFORM_EXTERNAL_BIT = 0x04
WAVEFORM_FORMATS = (4, 5, 9, 10)
WKT_BIT = 0x10
_WAVEFORM_RECORD = ("LASF_Spec", 65535)


@dataclass(frozen=True, slots=True)
class VariableRecord:
    """A VLR or EVLR: what stands before its payload, and where the payload is.

    Attributes:
        head: The record's own header as it stands in the file, 54 bytes (VLR) or 60 (EVLR).
        user_id: Who defined the record.
        record_id: Which record of theirs it is.
        offset: Position of the payload in the file, in bytes.
        length: Length of the payload, in bytes.
    """

    head: bytes
    user_id: str
    record_id: int
    offset: int
    length: int

    @property
    def key(self) -> tuple[str, int]:
        """User id and record id, which say together what the payload is."""
        return self.user_id, self.record_id

    @property
    def end(self) -> int:
        """Position of the first byte behind the record."""
        return self.offset + self.length

    def payload(self, file: BinaryIO, limit: int | None = None) -> bytes:
        """Read the payload, or its first `limit` bytes."""
        file.seek(self.offset)
        return file.read(self.length if limit is None else min(self.length, limit))


@dataclass(frozen=True, slots=True)
class LasHeader:
    """What a LAS header says, checked against the file.

    Attributes:
        raw: The header's bytes, with whatever a writer put behind the standard fields.
        minor: The version's minor number; the major one is 1.
        global_encoding: Bit field: GPS time type, waveform place, WKT.
        point_format: 0 to 10.
        compressed: Whether the points are LAZ.
        record_length: Bytes a point, extra bytes included.
        point_offset: Position of the points.
        num_points: At least 1.
        scales: (3,) float64, finite, not 0.
        offsets: (3,) float64, finite.
        bounds: (2, 3) float64 minimum and maximum, or None where the header's make no sense.
        vlrs: The records before the points.
        evlrs: The records behind the points.
        waveform: The EVLR with the waveforms, if they are inside this file.
        vlr_end: Position behind the last VLR; bytes from here to `point_offset` belong to no
            record.
    """

    raw: bytes
    minor: int
    global_encoding: int
    point_format: int
    compressed: bool
    record_length: int
    point_offset: int
    num_points: int
    scales: NDArray[np.float64]
    offsets: NDArray[np.float64]
    bounds: NDArray[np.float64] | None
    vlrs: tuple[VariableRecord, ...]
    evlrs: tuple[VariableRecord, ...]
    waveform: VariableRecord | None
    vlr_end: int


def read_header(path: Path, file: BinaryIO, size: int) -> LasHeader:
    """Parse and check the header, the VLRs and the EVLRs of a LAS or LAZ file.

    Args:
        path: The file, for messages.
        file: The file, open for reading.
        size: Its length in bytes.

    Raises:
        ReadError: Anything declared is impossible or doesn't fit into the file.
    """
    file.seek(0)
    start = file.read(HEADER_1_0.size)
    if not start.startswith(b"LASF"):
        raise ReadError(
            path, f"a file that begins with {start[:8]!r}", "LAS or LAZ, which begins with b'LASF'"
        )
    if len(start) < HEADER_1_0.size:
        raise ReadError(path, f"{size} bytes", "a LAS header of at least 227; copy the file again")
    (_, _, global_encoding, _, major, minor, _, _, _, _, header_size, *rest) = HEADER_1_0.unpack(
        start
    )
    point_offset, num_vlrs, format_byte, record_length, legacy_points, *rest = rest
    doubles = np.array(rest[5:])
    scales, offsets = doubles[:3], doubles[3:6]
    if major != 1 or minor not in HEADER_SIZES:
        raise ReadError(path, f"LAS {major}.{minor}", "LAS 1.0 to 1.4")
    if not HEADER_SIZES[minor] <= header_size <= point_offset <= size:
        raise ReadError(
            path,
            f"a header of {header_size} bytes, points at byte {point_offset:,} of {size:,}",
            f"a LAS 1.{minor} header of at least {HEADER_SIZES[minor]} bytes, points behind it "
            "and inside the file; copy or export it again",
        )
    file.seek(0)
    raw = file.read(header_size)
    point_format = format_byte & ~COMPRESSED_BIT
    _check_points(path, point_format, record_length, scales, offsets)
    num_points, first_evlr, num_evlrs, waveform_start = legacy_points, 0, 0, 0
    if minor >= 3:
        (waveform_start,) = WAVEFORM_START.unpack_from(raw, WAVEFORM_AT)
    if minor >= 4:
        first_evlr, num_evlrs, points, *_ = HEADER_1_4.unpack_from(raw, HEADER_1_4_AT)
        num_points = points or legacy_points
    if num_points == 0:
        raise ReadError(path, "a LAS file that holds no points", "points; was its export finished?")
    vlrs, vlr_end = _read_records(path, file, VLR_HEAD, header_size, num_vlrs, point_offset)
    evlrs, _ = _read_records(path, file, EVLR_HEAD, first_evlr, num_evlrs, size)
    waveform = None
    if global_encoding & WAVEFORM_INTERNAL_BIT:
        waveform = _find_waveform(file, waveform_start, size)
    header = LasHeader(
        raw=raw,
        minor=minor,
        global_encoding=global_encoding,
        point_format=point_format,
        compressed=bool(format_byte & COMPRESSED_BIT),
        record_length=record_length,
        point_offset=point_offset,
        num_points=num_points,
        scales=scales,
        offsets=offsets,
        bounds=_sensible_bounds(doubles[6:]),
        vlrs=vlrs,
        evlrs=evlrs,
        waveform=waveform,
        vlr_end=vlr_end,
    )
    if not header.compressed:
        _check_body(path, header, size)
    return header


def _check_points(
    path: Path,
    point_format: int,
    record_length: int,
    scales: NDArray[np.float64],
    offsets: NDArray[np.float64],
) -> None:
    if point_format >= len(RECORD_SIZES):
        raise ReadError(path, f"point format {point_format}", "point format 0 to 10")
    if record_length < RECORD_SIZES[point_format]:
        raise ReadError(
            path,
            f"{record_length} bytes a point",
            f"at least {RECORD_SIZES[point_format]} for point format {point_format}",
        )
    with np.errstate(over="ignore"):
        reach = np.abs(scales) * 2.0**31 + np.abs(offsets)
    if not np.isfinite(reach).all() or not scales.all():
        raise ReadError(
            path,
            f"scales {scales.tolist()} and offsets {offsets.tolist()}",
            "finite numbers and no scale of 0; the header is damaged",
        )


def _read_records(
    path: Path, file: BinaryIO, head: struct.Struct, start: int, count: int, limit: int
) -> tuple[tuple[VariableRecord, ...], int]:
    """Walk `count` records from `start`; none may reach beyond `limit`."""
    kind = "VLRs" if head is VLR_HEAD else "EVLRs"
    if count and start + count * head.size > limit:
        raise ReadError(
            path,
            f"{count:,} {kind} from byte {start:,}",
            f"no more than fit before byte {limit:,}; the file is damaged or cut off",
        )
    records = []
    position = start
    for index in range(count):
        record = _read_record(file, head, position)
        if record is None or record.end > limit:
            raise ReadError(
                path,
                f"{kind[:-1]} {index + 1} of {count:,} at byte {position:,} reaching too far",
                f"its end before byte {limit:,}; the file is damaged or cut off",
            )
        records.append(record)
        position = record.end
    return tuple(records), position


def _read_record(file: BinaryIO, head: struct.Struct, position: int) -> VariableRecord | None:
    file.seek(position)
    raw = file.read(head.size)
    if len(raw) < head.size:
        return None
    _, user_id, record_id, length, _ = head.unpack(raw)
    name = user_id.split(b"\0")[0].decode("latin-1")
    return VariableRecord(raw, name, record_id, position + head.size, length)


def _find_waveform(file: BinaryIO, start: int, size: int) -> VariableRecord | None:
    """The waveform EVLR; None where the header points at nothing of the kind."""
    if not 0 < start < size:
        return None
    record = _read_record(file, EVLR_HEAD, start)
    if record is None or record.end > size or record.key != _WAVEFORM_RECORD:
        return None
    return record


def _sensible_bounds(doubles: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The file interleaves them: max x, min x, max y, min y, max z, min z."""
    bounds = doubles.reshape(3, 2).T[::-1].copy()
    if not np.isfinite(bounds).all() or (bounds[0] > bounds[1]).any():
        return None
    return bounds


def _check_body(path: Path, header: LasHeader, size: int) -> None:
    """Uncompressed points must all be there, before whatever stands behind them."""
    behind = [record.offset - len(record.head) for record in header.evlrs]
    limit = min([start for start in behind if start >= header.point_offset], default=size)
    whole = (limit - header.point_offset) // header.record_length
    if whole < header.num_points:
        raise ReadError(
            path,
            f"room for {whole:,} points",
            f"the {header.num_points:,} its header declares; the file was cut off, copy it again",
        )
