"""Any other format to LAS 1.4: no point and no value lost."""

import re
from collections.abc import Mapping
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from laspy.point.dims import ALL_POINT_FORMATS_DTYPE

from bushseg.errors import WriteError
from bushseg.io.base import Codes, Columns, ScanReader, ScanWriter
from bushseg.io.las_crs import WKT_RECORD
from bushseg.io.las_header import HEADER_1_0, HEADER_1_4, HEADER_SIZES, WAVEFORM_START, WKT_BIT
from bushseg.io.las_points import EXTRA_BYTES_RECORD, PointLayout, Records
from bushseg.io.las_sink import LasSink, pack_vlr
from bushseg.io.las_survey import Survey, survey
from bushseg.io.las_writer import add_columns, set_classification
from bushseg.points import FloatArray, PointCloud

_INT32_REACH = 2.0**31 - 1
_MAX_VLR_PAYLOAD = 65535
_WKT = re.compile(r"[A-Z_]+\s*\[")


class LasConverter(ScanWriter):
    """A scan of another format as LAS 1.4, point format 7 with colours or 6 without.

    Coordinates keep seven digits over the scan's extent, in steps of 0.1 mm or finer (1 mm beyond
    400 km). Intensity and colours go where every LAS reader finds them: shares of 1 are stretched
    to 16 bits and 8-bit colours multiplied by 257; where that would change values, the column is
    kept besides, as the extra dimension `original_NAME`. A column with the name and dtype of a LAS
    field fills it; all others become extra dimensions, multi-valued ones as NAME_0, NAME_1, ...

    Args:
        path: The file to write; `.laz` is compressed.
        source: The scan the chunks come from; it is read once here.
        added: Name to dtype of each added column.

    Raises:
        ReadError: The source can't be read.
        WriteError: The file can't be written, or LAS can't hold what the source holds.
    """

    def __init__(self, path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> None:
        self._source = source.info.path
        self._survey = survey(source)
        has_colors = any(channel.field == "red" for channel in self._survey.channels.values())
        layout = PointLayout(7 if has_colors else 6)
        standard = dict(ALL_POINT_FORMATS_DTYPE[layout.point_format].descr[3:])  # behind X, Y, Z
        columns: dict[str, np.dtype[Any]] = {}
        self._direct: list[str] = []
        # Each extra dimension's column, and which of its values where there are several.
        self._origins: dict[str, tuple[str, int | None]] = {}
        for name, dtype in self._survey.columns.items():
            channel = self._survey.channels.get(name)
            if channel is not None and channel.exact:
                continue
            if channel is None and name in standard and standard[name] == dtype:
                self._direct.append(name)
                continue
            title = name if channel is None else f"original_{name}"
            for part in range(dtype.shape[0]) if dtype.shape else [None]:
                column = title if part is None else f"{title}_{part}"
                columns[column] = dtype.base
                self._origins[column] = name, part
        layout, self._columns = add_columns(layout, columns)
        layout, self._added = add_columns(layout, added)
        self._layout = layout
        vlrs = []
        if source.info.crs is not None and _WKT.match(source.info.crs.lstrip()):
            wkt = source.info.crs.encode() + b"\0"
            if len(wkt) <= _MAX_VLR_PAYLOAD:
                vlrs.append(pack_vlr(WKT_RECORD, "OGC WKT", wkt))
        if layout.extras:
            descriptors = b"".join(layout.described())
            vlrs.append(pack_vlr(EXTRA_BYTES_RECORD, "Extra bytes", descriptors))
        self._sink = LasSink(path, _new_header(self._survey), layout, vlrs)

    def write(self, chunk: PointCloud, added: Columns, codes: Codes | None) -> None:
        """Write one chunk of the source.

        Raises:
            WriteError: The disk is full, a class code is not within 0 to 255, or the source isn't
                what it was.
        """
        records = np.zeros(len(chunk), self._layout.dtype)
        self._set_coordinates(records, chunk.xyz)
        records["bit_fields"] = 0x11  # the first of one return: point format 6 knows no zeroth
        for name, channel in self._survey.channels.items():
            records[channel.field] = channel.convert(chunk.attributes[name])
        for name in self._direct:
            records[name] = chunk.attributes[name]
        for column, field in self._columns.items():
            name, part = self._origins[column]
            values = chunk.attributes[name]
            records[field] = values if part is None else values[:, part]
        for name, field in self._added.items():
            records[field] = added[name]
        if codes is not None:
            set_classification(records, codes, self._layout.point_format)
        self._sink.append(records)

    def close(self) -> None:
        """Write the counts and the bounds, and release the file."""
        try:
            self._sink.finish()
        finally:
            self.abort()

    def abort(self) -> None:
        """Release the file as it stands."""
        self._sink.close()

    def _set_coordinates(self, records: Records, xyz: FloatArray) -> None:
        for axis, name in enumerate("XYZ"):
            steps = np.rint((xyz[:, axis] - self._survey.offsets[axis]) / self._survey.scales[axis])
            if not (np.abs(steps) <= _INT32_REACH).all():
                raise WriteError(
                    f"{self._source}: a coordinate lies outside the bounds found at first; "
                    "the file changed while it was read"
                )
            records[name] = steps


def _new_header(found: Survey) -> bytes:
    """A LAS 1.4 header without counts and bounds."""
    today = date.today()
    start = HEADER_1_0.pack(
        *(b"LASF", 0, WKT_BIT, bytes(16), 1, 4),
        *(b"OTHER", f"bushseg {version('bushseg')}".encode()),
        *(today.timetuple().tm_yday, today.year, HEADER_SIZES[4]),
        *([0] * 10),
        *found.scales,
        *found.offsets,
        *([0.0] * 6),
    )
    return start + WAVEFORM_START.pack(0) + HEADER_1_4.pack(*[0] * 18)
