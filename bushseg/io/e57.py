"""E57, by way of libE57 (the optional dependency pye57): all scans of a file as one cloud.

libE57 is used directly: pye57's own `E57` class knows few fields, reads a scan whole, and removes
the file when opening it fails at the wrong moment.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bushseg.errors import ReadError
from bushseg.io.base import CHUNK_POINTS, ScanInfo, ScanReader, chunk_points
from bushseg.io.table import find_label
from bushseg.points import AttributeArray, PointCloud

SCAN_INDEX = "scan_index"

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_INVALID_STATE = {_CARTESIAN: "cartesianInvalidState", _SPHERICAL: "sphericalInvalidState"}
_RENAMED = {"colorRed": "red", "colorGreen": "green", "colorBlue": "blue"}
# The integers libE57's Python buffers handle rightly: others are refused or, for "l", half filled.
_INTEGERS = tuple(np.dtype(code) for code in "BbHhq")


@dataclass(frozen=True, slots=True)
class _Scan:
    """One of the file's scans.

    Attributes:
        points: libE57's node of the compressed points.
        count: How many points there are.
        fields: Name in the file to dtype of the buffer it is read into.
        point_bits: What a point takes in the file, at least.
        rotation: (3, 3), into the file's coordinates.
        translation: (3,), metres.
        posed: Whether the file states these, or they are the identity for want of a pose.
    """

    points: Any
    count: int
    fields: dict[str, np.dtype[Any]]
    point_bits: int
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    posed: bool

    @property
    def point_bytes(self) -> int:
        return sum(dtype.itemsize for dtype in self.fields.values())

    @property
    def coordinates(self) -> tuple[str, str, str]:
        return _CARTESIAN if _CARTESIAN[0] in self.fields else _SPHERICAL


class E57Reader(ScanReader):
    """An open E57 file.

    Each scan's points are moved by its pose into the file's common coordinates. Points the file
    marks as having no valid coordinates are kept, as NaN. A field some scans lack is 0 in those.
    """

    def __init__(self, path: Path) -> None:
        self._libe57 = _libe57(path)
        with _as_read_error(path, self._libe57):
            self._file = self._libe57.ImageFile(str(path), "r")
        try:
            with _as_read_error(path, self._libe57):
                self._scans = _read_headers(path, self._libe57, self._file.root())
                _check_counts(path, self._scans)
        except ReadError:
            self._file.close()
            raise
        attributes: dict[str, np.dtype[Any]] = {}
        for scan in self._scans:
            for field, dtype in scan.fields.items():
                if field not in scan.coordinates:
                    name = _RENAMED.get(field, field)
                    attributes[name] = np.promote_types(attributes.get(name, dtype), dtype)
        attributes[SCAN_INDEX] = np.dtype(np.int32)
        first = self._scans[0]
        self.info = ScanInfo(
            path=path,
            format=f"E57, {len(self._scans)} scan" + ("s" if len(self._scans) > 1 else ""),
            num_points=sum(scan.count for scan in self._scans),
            attributes=attributes,
            label_attribute=find_label(attributes),
            sensor_position=first.translation if len(self._scans) == 1 and first.posed else None,
        )

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        """Yield all points, scan after scan, at most `size` at a time.

        Raises:
            ReadError: The body is damaged or shorter than the header says.
        """
        for index, scan in enumerate(self._scans):
            num_read = 0
            for columns in self._columns(scan, chunk_points(size, scan.point_bytes)):
                count = len(columns[scan.coordinates[0]])
                num_read += count
                yield self._point_cloud(scan, index, columns, count)
            if num_read != scan.count:
                raise ReadError(
                    self.info.path,
                    f"{num_read:,} points in scan {index}",
                    f"{scan.count:,}; the file is truncated",
                )

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    def _columns(self, scan: _Scan, size: int) -> Iterator[dict[str, AttributeArray]]:
        """Yield a scan's fields as libE57 decodes them; the arrays are used again."""
        size = min(size, scan.count)
        buffers = self._libe57.VectorSourceDestBuffer()
        columns = {name: np.zeros(size, dtype=dtype) for name, dtype in scan.fields.items()}
        with _as_read_error(self.info.path, self._libe57):
            for name, column in columns.items():
                # True, True: convert numbers, and apply the scale of scaled integers.
                buffers.append(
                    self._libe57.SourceDestBuffer(self._file, name, column, size, True, True)
                )
            reader = scan.points.reader(buffers)
        try:
            while True:
                with _as_read_error(self.info.path, self._libe57):
                    count = reader.read()
                if not count:
                    return
                yield {name: column[:count] for name, column in columns.items()}
        finally:
            reader.close()

    def _point_cloud(
        self, scan: _Scan, index: int, columns: dict[str, AttributeArray], count: int
    ) -> PointCloud:
        xyz = np.stack([columns[name] for name in scan.coordinates], axis=1).astype(np.float64)
        if scan.coordinates == _SPHERICAL:
            xyz = _from_spherical(xyz)
        # State 1 means a direction without a distance, 2 nothing at all.
        invalid = columns.get(_INVALID_STATE[scan.coordinates])
        if invalid is not None:
            xyz[invalid != 0] = np.nan
        attributes: dict[str, AttributeArray] = {}
        fields = {_RENAMED.get(field, field): field for field in scan.fields}
        for name, dtype in self.info.attributes.items():
            if name == SCAN_INDEX:
                attributes[name] = np.full(count, index, dtype=dtype)
            elif name in fields:
                attributes[name] = columns[fields[name]].astype(dtype)
            else:
                attributes[name] = np.zeros(count, dtype=dtype)
        return PointCloud(xyz @ scan.rotation.T + scan.translation, attributes)


def open_e57(path: Path) -> ScanReader:
    """Open an E57 file.

    Raises:
        ReadError: pye57 isn't installed, the file is damaged, or it holds no points.
    """
    return E57Reader(path)


def _libe57(path: Path) -> Any:
    try:
        from pye57 import libe57
    except ImportError as error:
        raise ReadError(
            path,
            "an E57 file, and pye57 isn't installed",
            'the extra that reads E57; run `pip install "bushseg[e57]"`',
        ) from error
    return libe57


@contextmanager
def _as_read_error(path: Path, libe57: Any) -> Iterator[None]:
    """Turn what libE57 raises, and what nodes of unexpected types cause, into a ReadError."""
    try:
        yield
    except (
        libe57.E57Exception,
        AttributeError,
        LookupError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as error:
        reason = next(iter(str(error).splitlines()), "") or type(error).__name__
        raise ReadError(path, f"a damaged E57 file ({reason})", "a valid one") from error


def _read_headers(path: Path, libe57: Any, root: Any) -> list[_Scan]:
    """Describe each scan that has points."""
    nodes = list(root["data3D"]) if root.isDefined("data3D") else []
    scans = [
        _read_header(path, libe57, node)
        for node in nodes
        if node.isDefined("points") and node["points"].childCount() > 0
    ]
    if not scans:
        found = "only scans without points" if nodes else "no scans"
        raise ReadError(path, found, "at least one scan with points")
    return scans


def _read_header(path: Path, libe57: Any, node: Any) -> _Scan:
    points = node["points"]
    prototype = libe57.StructureNode(points.prototype())
    fields: dict[str, np.dtype[Any]] = {}
    bits = 0
    for index in range(prototype.childCount()):
        name = prototype.get(index).elementName()
        bits += _num_bits(libe57, prototype[name])
        dtype = _buffer_dtype(libe57, prototype[name])
        if dtype is not None:
            fields[name] = dtype
    if not any(set(names) <= set(fields) for names in (_CARTESIAN, _SPHERICAL)):
        raise ReadError(
            path, f"points with {', '.join(fields)}", "cartesian or spherical coordinates"
        )
    rotation, translation = np.eye(3), np.zeros(3)
    posed = bool(node.isDefined("pose"))
    if posed:
        pose = node["pose"]
        if pose.isDefined("rotation"):
            quaternion = [float(pose["rotation"][axis].value()) for axis in "xyzw"]
            rotation = Rotation.from_quat(quaternion).as_matrix()
        if pose.isDefined("translation"):
            translation = np.array([float(pose["translation"][axis].value()) for axis in "xyz"])
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
        raise ReadError(path, "a pose that isn't finite", "a rotation and a translation")
    return _Scan(points, int(points.childCount()), fields, bits, rotation, translation, posed)


def _check_counts(path: Path, scans: list[_Scan]) -> None:
    """Hold the points that the header counts against the file's size.

    A field of one possible value takes no bits; points of no bits count as one each.
    """
    size = path.stat().st_size
    needed = sum(scan.count * max(1, scan.point_bits) for scan in scans) // 8
    if needed > size:
        raise ReadError(
            path,
            f"{size:,} bytes",
            f"at least {needed:,} for the {sum(scan.count for scan in scans):,} points in its "
            "header; the file is damaged or cut off",
        )


def _num_bits(libe57: Any, node: Any) -> int:
    """How many bits a value of a field takes in the file, at least."""
    if isinstance(node, libe57.FloatNode):
        return 32 if node.precision() == libe57.FloatPrecision.E57_SINGLE else 64
    if isinstance(node, libe57.IntegerNode | libe57.ScaledIntegerNode):
        return int(node.maximum() - node.minimum()).bit_length()
    return 0


def _buffer_dtype(libe57: Any, node: Any) -> np.dtype[Any] | None:
    """The smallest type that holds a field's values, or None for one that isn't a number."""
    if isinstance(node, libe57.ScaledIntegerNode):
        return np.dtype(np.float64)
    if isinstance(node, libe57.FloatNode):
        single = node.precision() == libe57.FloatPrecision.E57_SINGLE
        return np.dtype(np.float32 if single else np.float64)
    if isinstance(node, libe57.IntegerNode):
        low, high = node.minimum(), node.maximum()
        for dtype in _INTEGERS:
            if np.iinfo(dtype).min <= low and high <= np.iinfo(dtype).max:
                return dtype
    return None


def _from_spherical(coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Range, azimuth and elevation (metres, radians) to x, y, z, as the E57 standard has them."""
    distance, azimuth, elevation = coordinates.T
    across = distance * np.cos(elevation)
    return np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], axis=1
    )
