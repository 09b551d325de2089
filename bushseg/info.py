"""What a scan holds, found by reading all of it."""

import operator
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.bundled import bundled_models
from bushseg.errors import ReadError
from bushseg.estimates import Estimate, estimate
from bushseg.features import source_columns
from bushseg.grid import VoxelGrid
from bushseg.io import open_scan
from bushseg.io.base import ScanReader
from bushseg.io.units import counts_in_feet
from bushseg.points import PointCloud
from bushseg.progress import SILENT, Progress
from bushseg.scan import anchor_of
from bushseg.voxel_count import VoxelCounter

_CELL = 1.0  # metres; density is counted over occupied cells of this edge
_MAX_CODES = 256
_BOUNDS_TOLERANCE = 0.01


@dataclass
class ScanReport:
    """One scan, described.

    Attributes:
        path: The file.
        error: Why it can't be read; then all else is as far as reading came.
        format: Such as "LAS 1.4 point format 7".
        num_points: Points read.
        bounds: Least and greatest coordinates, in the file's unit.
        crs: Coordinate reference system, as the file states it.
        density: Points per square metre (or squared unit of the file) of occupied ground.
        attributes: Name to least and greatest finite value; None where there is none.
        features: What of it the network can use: rgb, intensity.
        label_attribute: Where class codes stand.
        classes: Points per class code.
        faults: What looks wrong, a line each.
        estimates: What labelling it will take, by bundled model.
    """

    path: Path
    error: str | None = None
    format: str = ""
    num_points: int = 0
    bounds: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    crs: str | None = None
    density: float = 0.0
    attributes: dict[str, tuple[float, float] | None] = field(default_factory=dict)
    features: tuple[str, ...] = ()
    label_attribute: str | None = None
    classes: dict[int, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)

    def lines(self) -> Iterator[str]:
        """The report for people, line by line."""
        if self.error is not None:
            yield f"error: {self.error}"
            return
        yield f"{self.path}: {self.format}, {self.num_points:,} points"
        if self.bounds is not None:
            low, high = self.bounds
            extent = " x ".join(f"{b - a:,.2f}" for a, b in zip(low, high, strict=True))
            corners = " to ".join(
                "(" + ", ".join(f"{value:,.3f}" for value in corner) + ")" for corner in (low, high)
            )
            yield f"  extent      {extent}, from {corners}"
            yield f"  density     {self.density:,.1f} points per occupied square unit"
        yield f"  CRS         {_one_line(self.crs) if self.crs else 'not stated'}"
        yield f"  features    {', '.join((*self.features, 'height'))}"
        constants = []
        for name, span in self.attributes.items():
            if span is None:
                yield f"  {name:28} no finite value"
            elif span[0] == span[1]:
                constants.append(f"{name} {_number(span[0])}")
            else:
                yield f"  {name:28} {_number(span[0])} to {_number(span[1])}"
        if constants:
            yield f"  constant    {', '.join(constants)}"
        if self.label_attribute is not None:
            codes = ", ".join(f"{code}: {count:,}" for code, count in sorted(self.classes.items()))
            yield f"  classes     ({self.label_attribute}) {codes}"
        for one in self.estimates:
            scratch = f", {one.scratch / 1e9:.1f} GB of scratch files" if one.scratch else ""
            yield (
                f"  to label    with {one.model}, voxels of {one.voxel_size:g} m: about "
                f"{one.num_voxels:,} voxels, {_duration(one.seconds)}, "
                f"{one.memory / 1e9:.1f} GB of memory{scratch}"
            )
        for fault in self.faults:
            yield f"  fault       {fault}"


def describe(path: str | Path, *, progress: Progress = SILENT) -> ScanReport:
    """Read a scan and say what it holds.

    Args:
        path: The scan.
        progress: Told of the points read.

    Returns:
        The report; a file that can't be read gives one with `error` set, it doesn't raise.
    """
    report = ScanReport(Path(path))
    try:
        with open_scan(path) as reader:
            _fill(report, reader, progress)
    except ReadError as error:
        report.error = str(error)
    return report


def _fill(report: ScanReport, reader: ScanReader, progress: Progress) -> None:
    info = reader.info
    report.format, report.crs = info.format, info.crs
    report.label_attribute = info.label_attribute
    spans: dict[str, tuple[float, float]] = {}
    cells: NDArray[np.complex128] = np.empty(0, dtype=np.complex128)
    codes: Counter[int] = Counter()
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    num_bad = num_missing = 0
    models = bundled_models()
    counters: list[VoxelCounter] = []
    progress.start(f"reading {info.path.name}", info.num_points, "points")
    for chunk in reader.chunks():
        report.num_points += len(chunk)
        finite = np.isfinite(chunk.xyz).all(axis=1)
        num_bad += int(np.count_nonzero(~finite))
        if info.no_returns_at_origin:
            missing = finite & (chunk.xyz == 0).all(axis=1)
            num_missing += int(np.count_nonzero(missing))
            finite &= ~missing
        xyz = chunk.xyz[finite]
        if len(xyz):
            low, high = np.minimum(low, xyz.min(axis=0)), np.maximum(high, xyz.max(axis=0))
            anchor = anchor_of(xyz) if not counters else None
            if anchor is not None:
                grids = [VoxelGrid.around(anchor, model.voxel_size) for model in models]
                counters = [VoxelCounter(grid) for grid in grids]
            for counter in counters:
                counter.add(xyz)
            # As complex numbers: NumPy sorts them many times as fast as rows of two.
            here = np.floor(xyz[:, :2] / _CELL).view(np.complex128)
            cells = np.unique(np.concatenate([cells, np.unique(here)]))
        _widen(spans, chunk)
        if info.label_attribute is not None and len(codes) <= _MAX_CODES:
            column = chunk.attributes[info.label_attribute]
            values, counts = np.unique(column[np.isfinite(column)], return_counts=True)
            codes.update(dict(zip(map(int, values), map(int, counts), strict=True)))
        progress.advance(len(chunk))
    if np.isfinite(low).all():
        report.bounds = (tuple(low.tolist()), tuple(high.tolist()))
        report.density = (report.num_points - num_bad - num_missing) / (len(cells) * _CELL**2)
    report.attributes = {name: span if span[0] <= span[1] else None for name, span in spans.items()}
    used = source_columns(info.attributes)
    varied = {ours for ours, name in used.items() if name in spans and operator.lt(*spans[name])}
    colors = bool(varied & {"red", "green", "blue", "packed"})
    report.features = ("rgb",) * colors + ("intensity",) * ("intensity" in varied)
    report.classes = dict(codes)
    report.estimates = [
        estimate(model.name, model.voxel_size, report.num_points, counter.count)
        for model, counter in zip(models, counters, strict=False)
    ]
    report.faults = list(_faults(report, reader, num_bad, num_missing))


def _widen(spans: dict[str, tuple[float, float]], chunk: PointCloud) -> None:
    """Widen each attribute's span by a chunk's values."""
    for name, column in chunk.attributes.items():
        if not np.issubdtype(column.dtype, np.number):
            continue
        values = column[np.isfinite(column)]
        low, high = spans.get(name, (np.inf, -np.inf))
        if values.size:
            low, high = min(low, float(values.min())), max(high, float(values.max()))
        spans[name] = (low, high)


def _faults(
    report: ScanReport, reader: ScanReader, num_bad: int, num_missing: int
) -> Iterator[str]:
    """What a user should know before trusting the scan."""
    if num_bad:
        yield f"{num_bad:,} points are not finite; they will get no label"
    if num_missing:
        yield f"{num_missing:,} pulses did not return (0, 0, 0); they will get no label"
    stated = reader.info.bounds
    if stated is not None and report.bounds is not None:
        found = np.array(report.bounds)
        outside = np.max([stated[0] - found[0], found[1] - stated[1]])
        if outside > _BOUNDS_TOLERANCE:
            yield f"points lie up to {outside:,.2f} outside the bounds that the header states"
    if counts_in_feet(report.crs):
        yield "the CRS counts in feet; coordinates are taken for metres: reproject the scan first"


def _duration(seconds: float) -> str:
    """A rough duration for people."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _number(value: float) -> str:
    """A whole number in full, unless it is a no-data mark; any other in six digits."""
    return f"{value:,.0f}" if value.is_integer() and abs(value) < 1e15 else f"{value:g}"


def _one_line(text: str, width: int = 100) -> str:
    """A CRS may be pages of WKT."""
    line = " ".join(text.split())
    return line if len(line) <= width else line[: width - 3] + "..."
