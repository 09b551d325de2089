"""LAS to LAS: the points, byte by byte, and what the header says of them."""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from laspy.point.dims import ALL_POINT_FORMATS_DTYPE
from numpy.typing import NDArray

from bushseg.progress import Progress
from bushseg.verification.label_values import LabelValues
from bushseg.verification.las_container import Container
from bushseg.verification.las_extras import Extra, Extras
from bushseg.verification.las_points import Raw, chunk_points, raw_points
from bushseg.verification.result import Findings

_CODE_AT = {False: 15, True: 16}  # the class code's byte, by whether the format is 6 or more
_LEGACY_FLAGS = 0xE0
_LEGACY_MOST = 0xFFFFFFFF


@dataclass(slots=True)
class _Field:
    """A stretch of a record that must not change, and how often it did."""

    name: str
    type: np.dtype[Any]
    start: int
    count: int = 0
    first: str = ""


@dataclass(slots=True)
class Tally:
    """What the header must say of the points."""

    returns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(16, np.int64))
    low: NDArray[np.int64] = field(default_factory=lambda: np.full(3, 2**40))
    high: NDArray[np.int64] = field(default_factory=lambda: np.full(3, -(2**40)))

    def add(self, raw: Raw, *, modern: bool) -> None:
        """Count one chunk; `modern` are formats 6 to 10."""
        steps = np.ascontiguousarray(raw[:, :12]).view("<i4")
        self.low = np.minimum(self.low, steps.min(axis=0))
        self.high = np.maximum(self.high, steps.max(axis=0))
        self.returns += np.bincount(raw[:, 14] & (0x0F if modern else 0x07), minlength=16)


def compare_points(
    before: Container,
    after: Container,
    extras: Extras,
    labels: Mapping[str, Extra],
    values: LabelValues,
    findings: Findings,
    progress: Progress,
) -> None:
    """Compare all records, in order, and what the copy's header says of them.

    Args:
        before: The scan.
        after: Its copy; of the scan's point format, with records no shorter.
        extras: The scan's extra bytes.
        labels: Where the copy has its label columns.
        values: Told of labels and codes.
        findings: Told of the rest.
        progress: Told of points.

    Raises:
        ReadError: Points that don't decode.
    """
    modern = before.point_format >= 6
    length = before.record_bytes
    code_at = _CODE_AT[modern]
    fixed = np.ones(length, dtype=bool)
    fixed[code_at] = False
    for extra in labels.values():
        fixed[extra.start : min(extra.start + extra.size, length)] = False
    fields = _fields(before, extras)
    tally = Tally()
    size = chunk_points(before, after)
    num_seen = 0
    progress.start(f"comparing {after.path.name}", before.num_points, "points")
    pairs = zip(raw_points(before, size), raw_points(after, size), strict=True)
    for old, new in pairs:
        tally.add(new, modern=modern)
        same = old == new[:, :length]
        flags = 0 if modern else _LEGACY_FLAGS
        same[:, code_at] = ((old[:, code_at] ^ new[:, code_at]) & flags) == 0
        same |= ~(fixed | (np.arange(length) == code_at))
        if not same.all():
            _note(fields, old, new, same, num_seen)
        mask = 0xFF if modern else 0x1F
        columns = {name: _column(new, extra) for name, extra in labels.items()}
        values.add(old[:, code_at] & mask, new[:, code_at] & mask, columns)
        num_seen += len(old)
        progress.advance(len(old))
    findings.checked("point records", f"{num_seen:,} of {length} bytes, in order")
    for each in fields:
        if each.count:
            more = f"{each.count:,} of {num_seen:,} points differ"
            findings.differs("point records", f"{each.first} ({more})")
    compare_counts(before, after, tally, findings)


def compare_counts(
    before: Container | None, after: Container, tally: Tally, findings: Findings
) -> None:
    """The counts and bounds in a header against its points.

    Args:
        before: The scan it was copied from, whose own bounds may stay; None if it was converted.
        after: Whose header it is.
        tally: What the points make.
        findings: Told.
    """
    name = "counts and bounds"
    returns = tally.returns[1:].tolist()
    num_points = after.num_points
    findings.checked(name, f"{num_points:,} points, {sum(map(bool, returns))} kinds of returns")
    legacy = [num_points, *returns[:5]] if after.point_format < 6 else [0] * 6
    if num_points > _LEGACY_MOST:
        legacy = [0] * 6
    found = list(after.get("6I", 107))
    if found != legacy:
        findings.differs(name, f"counts {found}, the points make {legacy}")
    if after.minor >= 4:
        found, made = list(after.get("16Q", 247)), [num_points, *returns]
        if found != made:
            findings.differs(name, f"64-bit counts {found}, the points make {made}")
    scales = np.array(struct.unpack_from("<3d", after.header, 131))
    offsets = np.array(struct.unpack_from("<3d", after.header, 155))
    ends = np.stack([tally.low, tally.high]) * scales + offsets
    made_bounds = np.stack([ends.max(axis=0), ends.min(axis=0)], axis=1).ravel()
    old, new = (
        np.array(struct.unpack_from("<6d", c.header, 179)) for c in (before or after, after)
    )
    # The scan's own figures stay where they are right to half a step.
    fine = new == made_bounds
    if before is not None:
        fine |= (new == old) & (np.abs(new - made_bounds) <= np.repeat(np.abs(scales), 2) / 2)
    for index in np.flatnonzero(~fine):
        side = f"{'max' if index % 2 == 0 else 'min'} {'xyz'[index // 2]}"
        findings.differs(name, f"{side} {new[index]!s}, the points make {made_bounds[index]!s}")


def _fields(before: Container, extras: Extras) -> list[_Field]:
    fields = ALL_POINT_FORMATS_DTYPE[before.point_format].fields or {}
    found = [_Field(name, place[0], place[1]) for name, place in fields.items()]
    for extra in extras.described:
        dtype = np.dtype(f"<{extra.type}") if extra.type else np.dtype(f"V{extra.size}")
        found.append(_Field(extra.name, dtype, extra.start))
    if extras.num_left:
        start = before.record_bytes - extras.num_left
        found.append(_Field("undescribed extra bytes", np.dtype(f"V{extras.num_left}"), start))
    return found


def _note(fields: list[_Field], old: Raw, new: Raw, same: NDArray[np.bool_], first: int) -> None:
    """Count what differs, field by field, and show the first of each."""
    for each in fields:
        place = slice(each.start, each.start + each.type.itemsize)
        wrong = np.flatnonzero(~same[:, place].all(axis=1))
        if len(wrong) and not each.count:
            at = wrong[0]
            was, now = (_value(each.type, side[at, place]) for side in (old, new))
            each.first = f"point {first + at:,}: {each.name} {now}, was {was}"
        each.count += len(wrong)


def _value(dtype: np.dtype[Any], raw: NDArray[np.uint8]) -> str:
    if dtype.kind == "V":
        return "0x" + raw.tobytes()[:16].hex()
    return str(np.frombuffer(raw.tobytes(), dtype)[0])


def _column(raw: Raw, extra: Extra) -> NDArray[Any]:
    place = np.ascontiguousarray(raw[:, extra.start : extra.start + extra.size])
    return place.view(f"<{extra.type}")[:, 0]
