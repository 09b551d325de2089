"""Writing what was scanned: LAZ, and KITTI frames for the spinning LiDAR."""

import datetime
from collections.abc import Iterable
from pathlib import Path

import laspy
import numpy as np
from laspy.vlrs.known import WktCoordinateSystemVlr

from bushseg.errors import DataError
from bushseg.files import atomic_path
from bushseg.points import FloatArray
from bushseg.simulation.sensors.scanner import FULL_SCALE, Returns

SCALE = 0.001
FIRST_TIME = 441_763_200.0
"""GPS time less 1e9 s of the first station's first ray, in 2025."""

STATION_SECONDS = 600.0

NO_RETURN = "{}: no ray came back; expected returns, raise max_range"

UTM_32N = (
    'PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",DATUM["WGS_1984",'
    'SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],'
    'PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]],'
    'PROJECTION["Transverse_Mercator"],PARAMETER["latitude_of_origin",0],'
    'PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],'
    'PARAMETER["false_easting",500000],PARAMETER["false_northing",0],'
    'UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Easting",EAST],AXIS["Northing",NORTH],'
    'AUTHORITY["EPSG","32632"]]'
)
"""The CRS that made-up sites pretend to lie in, so that a GIS opens them."""


def write_laz(path: Path, batches: Iterable[Returns], origin: FloatArray, *, color: bool) -> int:
    """Write LAS 1.4, point format 7 with color and 6 without, millimetre steps.

    Times, returns, stations (`point_source_id`), classes and the extra dimension `instance`
    (uint32) are written beside intensity and color. The same returns give the same file, byte for
    byte.

    Args:
        path: The file; it appears whole or not at all.
        batches: Returns in order.
        origin: Projected coordinates of the site's origin, metres, shape (3,).
        color: Whether to write RGB.

    Returns:
        The number of points written.

    Raises:
        DataError: There is no return at all.
        WriteError: The folder can't be written to.
    """
    header = laspy.LasHeader(version="1.4", point_format=7 if color else 6)
    header.scales, header.offsets = np.full(3, SCALE), origin
    header.generating_software = "bushseg simulate"
    header.creation_date = datetime.date(2025, 1, 1)  # today's would make equal sites differ
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    header.global_encoding.wkt = True
    header.vlrs.append(WktCoordinateSystemVlr(UTM_32N))
    header.add_extra_dim(laspy.ExtraBytesParams("instance", np.uint32, "thing struck; 0: none"))
    num_points = 0
    with atomic_path(path) as partial, laspy.open(partial, mode="w", header=header) as writer:
        for returns in batches:
            if len(returns):
                writer.write_points(_record(header, returns, origin, color=color))
                num_points += len(returns)
        if not num_points:
            raise DataError(NO_RETURN.format(path))
    return num_points


def _record(
    header: laspy.LasHeader, returns: Returns, origin: FloatArray, *, color: bool
) -> laspy.ScaleAwarePointRecord:
    """One batch as LAS points."""
    record = laspy.ScaleAwarePointRecord.zeros(len(returns), header=header)
    xyz = returns.xyz + origin
    record["x"][:], record["y"][:], record["z"][:] = xyz.T
    record["intensity"][:] = returns.intensity
    record["return_number"][:] = returns.return_number
    record["number_of_returns"][:] = returns.num_returns
    record["classification"][:] = returns.class_code
    record["instance"][:] = returns.instance
    record["point_source_id"][:] = returns.station
    record["gps_time"][:] = FIRST_TIME + STATION_SECONDS * (returns.station - 1) + returns.time
    if color:
        for name, channel in zip(("red", "green", "blue"), returns.color.T, strict=True):
            record[name][:] = channel.astype(np.uint16) * 257  # 8 bits to all of 16
    return record


def write_kitti(path: Path, batches: Iterable[Returns]) -> int:
    """Write a frame as KITTI has it: a .bin, and a .label beside it.

    The .bin holds float32 x, y, z in metres from the sensor and intensity 0 to 1, every ray in
    order, rays without a return as zeros. The .label holds uint32: the class code in the lower 16
    bits (0 for no return), the instance in the upper.

    Args:
        path: The .bin file; both files appear whole or not at all, the .label first.
        batches: Returns of one turn in the sensor's own coordinates, in order, one a ray at most.

    Returns:
        The number of rays written.

    Raises:
        DataError: There is no return at all.
        WriteError: The folder can't be written to.
    """
    points, labels = [], []
    for returns in batches:
        point = np.zeros((returns.num_rays, 4), "<f4")
        point[returns.ray, :3] = returns.xyz
        point[returns.ray, 3] = returns.intensity / FULL_SCALE
        label = np.zeros(returns.num_rays, "<u4")
        label[returns.ray] = returns.class_code | returns.instance << 16
        points.append(point)
        labels.append(label)
    frame = np.concatenate(points)
    if not frame.any():
        raise DataError(NO_RETURN.format(path))
    with atomic_path(path.with_suffix(".label")) as partial:
        partial.write_bytes(np.concatenate(labels).tobytes())
    with atomic_path(path) as partial:
        partial.write_bytes(frame.tobytes())
    return len(frame)
