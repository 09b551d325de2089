"""A LAS file taken apart by `struct`, after LAS 1.4 R15; older versions are prefixes of it."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from bushseg.errors import ReadError

STANDARD_HEADER = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375}  # bytes, by minor version
RECORD_BYTES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)  # by point format
LASZIP = (b"laszip encoded", 22204)
EXTRA_BYTES = (b"LASF_Spec", 4)
WAVEFORMS = (b"LASF_Spec", 65535)
INTERNAL_WAVEFORMS, EXTERNAL_WAVEFORMS = 0x02, 0x04  # of the global encoding
_VLR, _EVLR = "<H16sHH32s", "<H16sHQ32s"
_BLOCK = 1 << 20


@dataclass(frozen=True, slots=True)
class Record:
    """A VLR or EVLR.

    Attributes:
        head: What stands before its payload: 54 bytes, or 60 of an EVLR.
        user_id: Whose record it is, without what fills it up.
        record_id: Which of theirs.
        start: Where the payload begins, in bytes.
        length: The payload's bytes.
    """

    head: bytes
    user_id: bytes
    record_id: int
    start: int
    length: int

    @property
    def key(self) -> tuple[bytes, int]:
        """User id and record id, which say together what it is."""
        return self.user_id, self.record_id

    @property
    def name(self) -> str:
        """User id and record id, for people."""
        return f"{self.user_id.decode('latin-1')} {self.record_id}"

    @property
    def end(self) -> int:
        """Where the next thing begins."""
        return self.start + self.length


@dataclass(frozen=True, slots=True)
class Container:
    """A LAS file but for its points.

    Attributes:
        path: The file.
        size: Its bytes.
        header: The header, with what stands behind its standard fields.
        vlrs: The records before the points.
        vlr_end: Where the last of them ends.
        evlrs: The records that the header lists behind the points.
        waveform: The record with the waveforms, listed or not; None where the header points at
            none.
    """

    path: Path
    size: int
    header: bytes
    vlrs: tuple[Record, ...]
    vlr_end: int
    evlrs: tuple[Record, ...]
    waveform: Record | None

    def get(self, layout: str, at: int) -> tuple[int, ...]:
        """Numbers of the header."""
        return struct.unpack_from(f"<{layout}", self.header, at)

    @property
    def minor(self) -> int:
        """The version is 1.minor."""
        return self.header[25]

    @property
    def point_format(self) -> int:
        """0 to 10."""
        return self.header[104] & 0x7F

    @property
    def compressed(self) -> bool:
        """Whether the points are LAZ."""
        return bool(self.header[104] & 0x80)

    @property
    def record_bytes(self) -> int:
        """Bytes a point."""
        return self.get("H", 105)[0]

    @property
    def point_offset(self) -> int:
        """Where the points begin."""
        return self.get("I", 96)[0]

    @property
    def num_points(self) -> int:
        """As the header counts them."""
        return _num_points(self.header)

    @property
    def first_evlr(self) -> int:
        """Where the header says that its EVLRs begin; 0 where there are none."""
        return self.get("Q", 235)[0] if self.minor >= 4 and self.evlrs else 0

    def payload(self, record: Record) -> bytes:
        """A record's content."""
        with self.path.open("rb") as file:
            file.seek(record.start)
            return file.read(record.length)

    def read(self, start: int, length: int) -> Iterator[bytes]:
        """A stretch of the file, in blocks."""
        with self.path.open("rb") as file:
            file.seek(start)
            while length > 0 and (block := file.read(min(length, _BLOCK))):
                length -= len(block)
                yield block


def read_container(path: Path) -> Container:
    """Parse a LAS or LAZ file's header and records.

    Raises:
        ReadError: It is none, or what it declares doesn't fit into it.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(STANDARD_HEADER[4])
        if len(header) < 227 or header[:4] != b"LASF":
            raise ReadError(path, f"a file that begins with {header[:4]!r}", "a LAS header")
        if header[24] != 1 or header[25] not in STANDARD_HEADER:
            raise ReadError(path, f"LAS {header[24]}.{header[25]}", "LAS 1.0 to 1.4")
        minor = header[25]
        (header_size,) = struct.unpack_from("<H", header, 94)
        point_offset, num_vlrs = struct.unpack_from("<II", header, 96)
        if not STANDARD_HEADER[minor] <= header_size <= point_offset <= size:
            raise ReadError(
                path,
                f"a header of {header_size:,} bytes, points at byte {point_offset:,} of {size:,}",
                f"at least {STANDARD_HEADER[minor]}, and points behind it inside the file",
            )
        file.seek(0)
        header = file.read(header_size)
        point_format, (length,) = header[104] & 0x7F, struct.unpack_from("<H", header, 105)
        if point_format >= len(RECORD_BYTES) or length < RECORD_BYTES[point_format]:
            raise ReadError(
                path,
                f"point format {point_format} of {length} bytes a point",
                "point format 0 to 10 and the bytes it needs",
            )
        if not header[104] & 0x80 and point_offset + _num_points(header) * length > size:
            raise ReadError(path, "fewer points than its header counts", "a whole file")
        vlrs = _walk(path, file, _VLR, header_size, num_vlrs, point_offset)
        evlrs: tuple[Record, ...] = ()
        if minor >= 4:
            start, count = struct.unpack_from("<QI", header, 235)
            evlrs = _walk(path, file, _EVLR, start, count, size)
        waveform = None
        if minor >= 3 and struct.unpack_from("<H", header, 6)[0] & INTERNAL_WAVEFORMS:
            waveform = _record(file, _EVLR, struct.unpack_from("<Q", header, 227)[0], size)
            if waveform is not None and waveform.key != WAVEFORMS:
                waveform = None
    vlr_end = vlrs[-1].end if vlrs else header_size
    return Container(path, size, header, vlrs, vlr_end, evlrs, waveform)


def first_difference(
    left: Container, start: int, right: Container, other: int, length: int
) -> int | None:
    """Which byte of two stretches of equal length differs first, counting from their beginnings."""
    seen = 0
    for a, b in zip(left.read(start, length), right.read(other, length), strict=True):
        if a != b:
            return seen + next(
                index for index, (p, q) in enumerate(zip(a, b, strict=False)) if p != q
            )
        seen += len(a)
    return None


def _num_points(header: bytes) -> int:
    (legacy,) = struct.unpack_from("<I", header, 107)
    count: int = struct.unpack_from("<Q", header, 247)[0] if header[25] >= 4 else 0
    return count or int(legacy)


def _walk(
    path: Path, file: BinaryIO, layout: str, at: int, count: int, limit: int
) -> tuple[Record, ...]:
    kind = "VLR" if layout == _VLR else "EVLR"
    if count * struct.calcsize(layout) > limit:
        raise ReadError(path, f"{count:,} {kind}s", f"no more than fit into {limit:,} bytes")
    records: list[Record] = []
    for index in range(count):
        record = _record(file, layout, at, limit)
        if record is None:
            raise ReadError(
                path,
                f"{kind} {index + 1} of {count:,} at byte {at:,} reaching too far",
                f"its end before byte {limit:,}",
            )
        records.append(record)
        at = record.end
    return tuple(records)


def _record(file: BinaryIO, layout: str, at: int, limit: int) -> Record | None:
    if not 0 < at < limit:
        return None
    file.seek(at)
    head = file.read(struct.calcsize(layout))
    if len(head) < struct.calcsize(layout):
        return None
    _, user_id, record_id, length, _ = struct.unpack(layout, head)
    record = Record(head, user_id.split(b"\0")[0], record_id, at + len(head), length)
    return record if record.end <= limit else None
