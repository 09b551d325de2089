"""The file a LAS writer fills: header, VLRs, points, EVLRs, and the header once more.

Counts and bounds are only known at the end, so the header is written twice. Points are compressed
by lazrs, in parallel, which gives the same bytes as its sequential compressor in half the time on
two cores.
"""

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO

import lazrs
import numpy as np

from bushseg.errors import WriteError
from bushseg.io.las_header import (
    COMPRESSED_BIT,
    EVLR_HEAD,
    HEADER_1_4,
    HEADER_1_4_AT,
    RECORD_SIZES,
    VLR_HEAD,
    WAVEFORM_AT,
    WAVEFORM_START,
)
from bushseg.io.las_points import PointLayout, Records
from bushseg.io.laz import garbles_waveforms
from bushseg.io.laz_body import LASZIP_RECORD, lazrs_errors
from bushseg.parallel import for_chunks

_MINOR_AT = 25
_PLACES_AT = struct.Struct("<II"), 96  # point offset, number of VLRs
_RECORD_AT = struct.Struct("<BH"), 104  # point format, record length
_LEGACY_AT = struct.Struct("<6I"), 107  # points, points of the first five returns
_SCALES_AT = struct.Struct("<6d"), 131
_BOUNDS_AT = struct.Struct("<6d"), 179
_MAX_LEGACY = 0xFFFFFFFF
_COPY_BYTES = 1 << 20
_CHUNK = 65_536  # records a thread takes at a time


@dataclass(frozen=True, slots=True)
class Evlr:
    """An EVLR to be written.

    Attributes:
        head: Its own header, 60 bytes.
        offset: Where its payload is in the file it is copied from, in bytes.
        is_waveform: Whether the header has to say where it went.
    """

    head: bytes
    offset: int
    is_waveform: bool


def pack_vlr(key: tuple[str, int], description: str, payload: bytes) -> bytes:
    """A whole VLR."""
    user_id, record_id = key
    head = VLR_HEAD.pack(0, user_id.encode(), record_id, len(payload), description.encode())
    return head + payload


class LasSink:
    """A LAS or LAZ file being written; which one is told by the path's last suffix.

    Args:
        path: The file to write.
        header: A header of the version wanted; its counts, bounds and offsets are replaced.
        layout: The fields of each record.
        vlrs: Whole VLRs, without a LASzip one.
        gap: Bytes that stand between the VLRs and the points and belong to neither.

    Raises:
        WriteError: The file can't be written, or has no room for so many VLRs.
    """

    def __init__(
        self,
        path: Path,
        header: bytes,
        layout: PointLayout,
        vlrs: Sequence[bytes],
        gap: bytes = b"",
    ) -> None:
        self._path = path
        self._header = bytearray(header)
        self._layout = layout
        self._minor = header[_MINOR_AT]
        self._num_points = 0
        self._returns = np.zeros(16, np.int64)
        self._low = np.full(3, np.iinfo(np.int64).max)
        self._high = np.full(3, np.iinfo(np.int64).min)
        self._lock = Lock()
        self._first_flags: np.uint8 | None = None
        self._compressor: Any = None
        num_extra = layout.dtype.itemsize - RECORD_SIZES[layout.point_format]
        laszip = None
        if path.suffix.lower() == ".laz":
            laszip = lazrs.LazVlr.new_for_compression(layout.point_format, num_extra)
            vlrs = [*vlrs, pack_vlr(LASZIP_RECORD, "LASzip by laz-rs", laszip.record_data())]
        point_offset = len(header) + sum(map(len, vlrs)) + len(gap)
        if point_offset > _MAX_LEGACY:
            raise WriteError(f"{path}: {point_offset:,} bytes of VLRs; LAS has room for 4 GiB")
        self._pack(_PLACES_AT, point_offset, len(vlrs))
        compressed = COMPRESSED_BIT if laszip is not None else 0
        self._pack(_RECORD_AT, layout.point_format | compressed, layout.dtype.itemsize)
        with self._write_errors():
            self._file: BinaryIO = path.open("wb")
            try:
                self._file.write(self._header)
                self._file.writelines(vlrs)
                self._file.write(gap)
                if laszip is not None:
                    self._told = _Told(self._file)
                    self._compressor = lazrs.ParLasZipCompressor(self._told, laszip)
            except BaseException:
                self.close()
                raise

    def append(self, records: Records) -> None:
        """Write point records of the sink's layout, shape (N,).

        Raises:
            WriteError: The disk is full, or the version can't count so many points.
        """
        if not len(records):
            return
        self._num_points += len(records)
        if self._minor < 4 and self._num_points > _MAX_LEGACY:
            raise WriteError(
                f"{self._path}: LAS 1.{self._minor} holds {_MAX_LEGACY:,} points at most; "
                "split the scan or make it LAS 1.4"
            )
        self._check_channels(records)
        for_chunks(lambda start, stop: self._count(records[start:stop]), len(records), _CHUNK)
        raw = np.ascontiguousarray(records).view(np.uint8)
        with self._write_errors():
            if self._compressor is None:
                self._file.write(raw.data)
            else:
                self._compressor.compress_many(raw)

    def finish(self, evlrs: Sequence[Evlr] = (), source: BinaryIO | None = None) -> None:
        """Write the EVLRs, then the counts, the bounds and where everything is.

        Args:
            evlrs: What to copy behind the points.
            source: The file they are copied from.

        Raises:
            WriteError: The disk is full.
        """
        with self._write_errors():
            if self._compressor is not None:
                self._compressor.done()
            self._file.seek(0, 2)
            first_evlr = self._file.tell() if evlrs else 0
            for evlr in evlrs:
                assert source is not None
                if evlr.is_waveform:
                    WAVEFORM_START.pack_into(self._header, WAVEFORM_AT, self._file.tell())
                self._file.write(evlr.head)
                length = EVLR_HEAD.unpack(evlr.head)[3]
                _copy_range(source, self._file, evlr.offset, length)
            self._pack_counts(first_evlr, len(evlrs))
            self._pack_bounds()
            self._file.seek(0)
            self._file.write(self._header)
            self._file.close()  # what is still buffered may not fit on the disk

    def close(self) -> None:
        """Release the file, finished or not."""
        self._compressor = None
        with suppress(OSError):  # a full disk, which finish() or append() has told of
            self._file.close()

    def _count(self, records: Records) -> None:
        """Take note of returns and bounds; called by several threads."""
        mask = 0x07 if self._layout.point_format < 6 else 0x0F
        returns = np.bincount(records["bit_fields"] & mask, minlength=16)
        low = [records[name].min() for name in "XYZ"]
        high = [records[name].max() for name in "XYZ"]
        with self._lock:
            self._returns += returns
            np.minimum(self._low, low, out=self._low)
            np.maximum(self._high, high, out=self._high)

    def _check_channels(self, records: Records) -> None:
        if self._compressor is None or self._layout.point_format < 6:
            return
        flags = records["classification_flags"]
        self._first_flags = flags[0] if self._first_flags is None else self._first_flags
        if garbles_waveforms(self._layout.point_format, flags, self._first_flags):
            raise WriteError(
                f"{self._path}: waveform packets of several scanner channels, which lazrs garbles; "
                "choose .las for the output"
            )

    def _pack(self, place: tuple[struct.Struct, int], *values: float) -> None:
        layout, at = place
        layout.pack_into(self._header, at, *values)

    def _pack_counts(self, first_evlr: int, num_evlrs: int) -> None:
        by_return = self._returns[1:].tolist()
        # Formats 6 to 10 leave the counts of LAS 1.0 to 1.3 at 0 (LAS 1.4 R15, 2.4).
        legacy = self._layout.point_format < 6 and self._num_points <= _MAX_LEGACY
        self._pack(_LEGACY_AT, *([self._num_points, *by_return[:5]] if legacy else [0] * 6))
        if self._minor >= 4:
            place = HEADER_1_4, HEADER_1_4_AT
            self._pack(place, first_evlr, num_evlrs, self._num_points, *by_return)

    def _pack_bounds(self) -> None:
        """Replace each bound that is off by more than rounding; a right one keeps its bits."""
        numbers = np.array(_SCALES_AT[0].unpack_from(self._header, _SCALES_AT[1]))
        scales, offsets = numbers[:3], numbers[3:]
        ends = np.stack([self._low, self._high]) * scales + offsets
        bounds = np.stack([ends.max(axis=0), ends.min(axis=0)], axis=1)
        before = np.array(_BOUNDS_AT[0].unpack_from(self._header, _BOUNDS_AT[1])).reshape(3, 2)
        keep = np.abs(before - bounds) <= np.abs(scales[:, np.newaxis]) / 2
        self._pack(_BOUNDS_AT, *np.where(keep, before, bounds).ravel().tolist())

    @contextmanager
    def _write_errors(self) -> Iterator[None]:
        """Turn what the disk and lazrs refuse into a WriteError."""
        path = self._path
        try:
            try:
                with lazrs_errors(lambda reason: WriteError(f"{path}: can't compress ({reason})")):
                    yield
            except WriteError:
                if self._compressor is not None and self._told.refusal is not None:
                    raise self._told.refusal from None  # lazrs only says that there was one
                raise
        except OSError as error:
            raise WriteError(f"{path}: can't write ({error.strerror or error})") from error


class _Told:
    """A file as lazrs wants it, which remembers what the disk refused to do.

    Attributes:
        refusal: The last error of a write.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.refusal: OSError | None = None
        self.seek, self.tell, self.flush = file.seek, file.tell, file.flush

    def write(self, data: bytes) -> int:
        """Write as the file does."""
        try:
            return self._file.write(data)
        except OSError as error:
            self.refusal = error
            raise


def _copy_range(source: BinaryIO, target: BinaryIO, offset: int, length: int) -> None:
    """Copy bytes without holding all of them."""
    source.seek(offset)
    left = length
    while left:
        piece = source.read(min(left, _COPY_BYTES))
        if not piece:
            raise WriteError(f"{source.name}: shrank while it was read; run again")
        target.write(piece)
        left -= len(piece)
