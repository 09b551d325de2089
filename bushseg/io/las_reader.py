"""LAS, LAZ and COPC in, chunk by chunk.

The container is parsed by :mod:`bushseg.io.las_header`, the points' fields by
:mod:`bushseg.io.las_points`, compressed points by :mod:`bushseg.io.laz_body` and
:mod:`bushseg.io.laz`. A COPC file is a LAZ file with an index; it is read as LAZ, in the file's
order.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.io.base import CHUNK_POINTS, ScanInfo, ScanReader, chunk_points
from bushseg.io.las_crs import read_crs
from bushseg.io.las_header import (
    RECORD_SIZES,
    WAVEFORM_EXTERNAL_BIT,
    WAVEFORM_FORMATS,
    LasHeader,
    read_header,
)
from bushseg.io.las_points import (
    DESCRIPTOR_BYTES,
    EXTRA_BYTES_RECORD,
    PointLayout,
    parse_layout,
    scale_coordinates,
)
from bushseg.io.laz import decompress
from bushseg.io.laz_body import LazBody, inspect_laz
from bushseg.io.laz_process import LazProcess
from bushseg.io.sniff import check_file
from bushseg.points import PointCloud


class LasReader(ScanReader):
    """An open LAS or LAZ file.

    The attributes of its chunks are all fields of the point format under laspy's names
    (`classification`, `return_number`, `scan_angle_rank` or `scan_angle`, ...) and all extra bytes,
    scaled ones as float64; extra bytes nobody described come as `ExtraBytes`, shape (N, M), uint8.
    A chunk's `record` is the structured array of its raw records (:attr:`layout`), byte for byte.

    Attributes:
        header: The checked header.
        layout: The fields of each record.
    """

    def __init__(self, path: Path) -> None:
        check_file(path)
        size = path.stat().st_size
        self._file = path.open("rb")
        self._process = LazProcess(path)
        try:
            self.header: LasHeader = read_header(path, self._file, size)
            self._body: LazBody | None = None
            if self.header.compressed:
                self._body = inspect_laz(path, self._file, self.header, size, self._process)
            self.layout: PointLayout = self._read_layout()
            self.info = self._describe(path)
        except BaseException:
            self.close()
            raise

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        """Yield all points in the file's order, at most `size` (and 128 MB of records) at a time.

        Raises:
            ReadError: The compressed points are damaged, or the file shrank meanwhile.
        """
        dtype = self.layout.dtype
        size = chunk_points(size, dtype.itemsize)
        num_points = 0
        try:
            for raw in self._raw_chunks(size):
                records = raw.view(dtype)
                num_points += len(records)
                xyz = scale_coordinates(records, self.header.scales, self.header.offsets)
                yield PointCloud(xyz, self.layout.attributes(records), records)
        except OSError as error:
            found = f"unreadable after {num_points:,} points ({error.strerror or error})"
            raise ReadError(self.info.path, found, "a file on a disk that works") from error
        if num_points != self.header.num_points:
            raise ReadError(
                self.info.path,
                f"{num_points:,} points",
                f"{self.header.num_points:,}; the file changed while it was read",
            )

    def close(self) -> None:
        """Release the file."""
        self._process.close()
        self._file.close()

    def _raw_chunks(self, size: int) -> Iterator[NDArray[np.uint8]]:
        header = self.header
        if self._body is not None:
            yield from decompress(self.info.path, self._process, header, self._body, size)
            return
        for begin in range(0, header.num_points, size):
            num_points = min(size, header.num_points - begin)
            self._file.seek(header.point_offset + begin * header.record_length)
            raw = np.empty(num_points * header.record_length, np.uint8)
            got = self._file.readinto(raw.data)
            yield raw[: got // header.record_length * header.record_length]

    def _read_layout(self) -> PointLayout:
        header = self.header
        num_extra_bytes = header.record_length - RECORD_SIZES[header.point_format]
        records = (r for r in header.vlrs + header.evlrs if r.key == EXTRA_BYTES_RECORD)
        described = next(records, None)
        payload = b""
        if described is not None:
            # An EVLR may be gigabytes; a byte has one descriptor at most, and one more is wrong.
            payload = described.payload(self._file, DESCRIPTOR_BYTES * (num_extra_bytes + 1))
        return parse_layout(header.point_format, num_extra_bytes, payload)

    def _describe(self, path: Path) -> ScanInfo:
        header = self.header
        kind = "LAZ" if header.compressed else "LAS"
        if any(record.user_id == "copc" for record in header.vlrs):
            kind = "COPC LAZ"
        outside = header.global_encoding & WAVEFORM_EXTERNAL_BIT and header.waveform is None
        return ScanInfo(
            path=path,
            format=f"{kind} 1.{header.minor} point format {header.point_format}",
            num_points=header.num_points,
            attributes=self.layout.attribute_dtypes(),
            label_attribute="classification",
            bounds=header.bounds,
            crs=read_crs(header, self._file),
            waveforms=(
                path.with_suffix(".wdp")
                if outside and header.point_format in WAVEFORM_FORMATS
                else None
            ),
        )
