"""Another format to LAS: coordinates to half a step, every attribute to be had again."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
from laspy.point.dims import ALL_POINT_FORMATS_DTYPE
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.progress import Progress
from bushseg.verification.columns import Differences, equal, flattened, own_codes
from bushseg.verification.label_values import LabelValues
from bushseg.verification.las_container import Container, read_container
from bushseg.verification.las_copy import check_ends
from bushseg.verification.las_extras import LABEL_COLUMNS, Extra, read_extras
from bushseg.verification.las_points import chunk_points, raw_points
from bushseg.verification.las_records import Tally, compare_counts
from bushseg.verification.libraries import open_columns
from bushseg.verification.result import Findings
from bushseg.verification.rows import Columns

_HALF_STEP = 0.51
# Where LAS readers look for what other formats call so.
_CHANNELS = {
    **dict.fromkeys(("intensity", "scalar_intensity", "reflectance", "i"), "intensity"),
    **{
        f"{prefix}{color}": color
        for color in ("red", "green", "blue")
        for prefix in ("", "diffuse_", "scalar_")
    },
    "r": "red",
    "g": "green",
    "b": "blue",
}
_FACTORS = (1, 257, 65535)  # 8-bit colors and shares of 1 are stretched to 16 bits
_Plan = dict[str, tuple[str, list[int]]]
_ONE_RETURN = 0x11
"""Return 1 of 1, which formats without returns have."""


def compare_converted(
    source: Path, copy: Path, values: LabelValues, findings: Findings, progress: Progress
) -> None:
    """Compare a scan of another format with the LAS or LAZ made of it."""
    after = read_container(copy)
    check_ends(after, findings)
    dtype, extras = _layout(after)
    size = chunk_points(after)
    found, tally, first = Differences(), Tally(), 0
    plan: _Plan | None = None
    shown: _Plan = {}
    own: str | None = None
    scales, offsets = (np.array(struct.unpack_from("<3d", after.header, at)) for at in (131, 155))
    progress.start(f"comparing {copy.name}", after.num_points, "points")
    stream = raw_points(after, size)
    for old in open_columns(source).chunks(size):
        try:
            raw = next(stream)
        except StopIteration:
            raw = np.empty((0, after.record_bytes), np.uint8)
        if len(raw) != len(old["xyz"]):
            findings.differs("points", f"{after.num_points:,}, the scan has another number")
            return
        new = raw.reshape(-1).view(dtype)
        tally.add(raw, modern=after.point_format >= 6)
        if plan is None:
            plan, shown = _plan(old, dtype, findings)
            own = own_codes(old)
        for axis in range(3):
            now = new["XYZ"[axis]] * scales[axis] + offsets[axis]
            was = old["xyz"][:, axis]
            near = np.abs(now - was) <= abs(scales[axis]) * _HALF_STEP
            found.compare("xyz"[axis], first, now, was, near)
        for name, column in flattened(old):
            if name in plan:
                field, factors = plan[name]
                _compare_scaled(found, name, first, new[field], column, factors)
            if name in shown:
                field, factors = shown[name]
                title = f"{field} (of {name})"
                _compare_scaled(found, title, first, new[field], column, factors, rounded=True)
        _check_empty(found, first, new, {field for field, _ in plan.values()}, after)
        labels = {title: new[field] for title, field in extras.items()}
        values.add(None if own is None else old[own], new["classification"], labels)
        first += len(raw)
        progress.advance(len(raw))
    findings.num_points = first
    if first != after.num_points:
        findings.differs("points", f"{after.num_points:,}, were {first:,}")
        return
    findings.checked("points", f"{first:,}, in order, to half a step of {scales[0]:g}")
    found.report("points", first, findings)
    compare_counts(None, after, tally, findings)
    values.report(findings, has_codes=own is not None)
    findings.declared.extend(f"{field} added" for field in extras.values())


def _layout(after: Container) -> tuple[np.dtype[Any], dict[str, str]]:
    """The copy's records, and where its label columns are: the last of each name."""
    extras = read_extras(after)
    if extras.num_left or after.point_format not in (6, 7):
        raise ReadError(after.path, "records that bushseg doesn't make of other formats", "its own")
    standard = ALL_POINT_FORMATS_DTYPE[after.point_format].descr
    own = [
        (each.name, f"<{each.type}" if each.type else f"V{each.size}") for each in extras.described
    ]
    labels: dict[str, str] = {}
    for each in extras.described:
        title = _title(each)
        if title:
            labels[title] = each.name
    return np.dtype([*standard, *own]), labels


def _title(extra: Extra) -> str:
    base, _, number = extra.name.rpartition("_")
    title = base if number.isdecimal() else extra.name
    return title if LABEL_COLUMNS.get(title) == extra.type else ""


def _plan(old: Columns, dtype: np.dtype[Any], findings: Findings) -> tuple[_Plan, _Plan]:
    """Attribute to the field that holds it, and to the 16 bits that every LAS reader shows.

    Either with the factors its values may have there; the second only where it isn't the first.
    """
    names = [name for name, _ in flattened(old)]
    findings.checked("columns", f"{len(names)} of the scan")
    plan: _Plan = {}
    shown: _Plan = {}
    for name in names:
        if name == "classification" or name in LABEL_COLUMNS:
            continue  # written over
        short = name.encode()[:32].decode("utf-8", "ignore")
        original = f"original_{name}".encode()[:32].decode("utf-8", "ignore")
        fields = dtype.names or ()
        channel = _CHANNELS.get(name.lower(), "")
        if channel in fields and original in fields:
            plan[name] = original, [1]
            shown[name] = channel, list(_FACTORS)
        elif channel in fields and (short == channel or short not in fields):
            plan[name] = channel, list(_FACTORS)
        elif short in fields:
            plan[name] = short, [1]
        elif f"{short}_2" in fields:  # the name of a standard field of another type
            plan[name] = f"{short}_2", [1]
        else:
            findings.differs("columns", f"{name} is missing")
    return plan, shown


def _compare_scaled(
    found: Differences,
    name: str,
    first: int,
    now: NDArray[Any],
    was: NDArray[Any],
    factors: list[int],
    *,
    rounded: bool = False,
) -> None:
    """Compare a column that may have been stretched, by one factor for all points."""
    for factor in factors[:]:
        expected = was if factor == 1 else was.astype(np.float64) * factor
        if rounded:
            expected = np.clip(np.rint(np.nan_to_num(expected, nan=0.0)), 0, 65535)
        same = equal(now, expected)
        if same.all():
            return
        if len(factors) > 1:
            factors.remove(factor)
    found.compare(name, first, now, was, same)


def _check_empty(
    found: Differences, first: int, new: NDArray[np.void], filled: set[str], after: Container
) -> None:
    """Fields that the scan says nothing of say nothing."""
    for name in ALL_POINT_FORMATS_DTYPE[after.point_format].names or ():
        if name in filled or name in ("X", "Y", "Z", "classification", *_CHANNELS.values()):
            continue
        expected = np.full(len(new), _ONE_RETURN if name == "bit_fields" else 0, new[name].dtype)
        found.compare(name, first, new[name], expected, new[name] == expected)
