"""Any format to a table: every column of the scan, and labels beside them."""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.progress import Progress
from bushseg.scheme import ClassScheme
from bushseg.verification.columns import (
    CHUNK_POINTS,
    CODES,
    Differences,
    added_name,
    equal,
    flattened,
    own_codes,
)
from bushseg.verification.label_values import LabelValues
from bushseg.verification.libraries import open_columns
from bushseg.verification.result import Findings
from bushseg.verification.rows import Columns, Scan
from bushseg.verification.tables import open_text

_TEXT = (".csv", ".txt", ".xyz")
_POINTS = "points"


def compare_table(
    source: Path, copy: Path, values: LabelValues, findings: Findings, progress: Progress
) -> None:
    """Compare a scan with a PLY, PCD or text made of it."""
    before, after = open_columns(source), _open_copy(copy)
    found = Differences()
    progress.start(f"comparing {copy.name}", None, "points")
    plan: dict[str, str] | None = None
    first = 0
    for old, new in itertools.zip_longest(before.chunks(CHUNK_POINTS), after.chunks(CHUNK_POINTS)):
        if old is None or new is None or len(old["xyz"]) != len(new["xyz"]):
            _count((before, after), findings)
            return
        if plan is None:
            plan = _plan(old, new, before, copy.suffix.lower() in _TEXT, findings)
        for axis in range(3):
            now, was = new["xyz"][:, axis], old["xyz"][:, axis]
            found.compare("xyz"[axis], first, now, was, equal(now, was))
        for name, column in flattened(old):
            if name in plan:
                now = new[plan[name]]
                found.compare(name, first, now, column, equal(now, column))
        labels = {
            title: column
            for name, column in new.items()
            if name not in plan.values() and (title := added_name(name)) is not None
        }
        codes = next((labels.pop(name) for name in reversed(CODES) if name in labels), None)
        own = own_codes(old)
        if "class_index" in labels:
            labels["class_index"] = labels["class_index"].astype(np.uint8)
        values.add(None if own is None else old[own], codes, labels)
        first += len(old["xyz"])
        progress.advance(len(old["xyz"]))
        has_own = own is not None
    findings.num_points = first
    findings.checked(_POINTS, f"{first:,}, in order")
    found.report(_POINTS, first, findings)
    values.report(findings, has_codes=first > 0 and has_own)


def compare_codes(
    source: Path,
    copy: Path,
    scheme: ClassScheme | None,
    findings: Findings,
    progress: Progress,
) -> None:
    """Compare a scan with a `.label` or `.labels` made of it: a code a point, of the scheme."""
    if copy.suffix.lower() == ".label":
        codes: NDArray[Any] = np.memmap(copy, "<u4", "r")
    else:
        codes = np.loadtxt(copy, np.int64, ndmin=1)
    progress.start(f"comparing {copy.name}", None, "points")
    num_points = num_changed = 0
    known = None
    if scheme is not None:
        known = [*(info.codes[0] for info in scheme.classes), scheme.unlabelled[0]]
    own = None
    for old in open_columns(source).chunks(CHUNK_POINTS):
        part = np.asarray(codes[num_points : num_points + len(old["xyz"])])
        own = own_codes(old)
        if own is not None and len(part) == len(old["xyz"]):
            num_changed += int(np.count_nonzero(part != old[own]))
        fine = np.isin(part, known) if known is not None else part < 1 << 16
        if not fine.all():
            at = int(np.argmin(fine))
            line = f"point {num_points + at:,}: code {part[at]}, which is no class's"
            findings.differs("labels", line)
        num_points += len(old["xyz"])
        progress.advance(len(old["xyz"]))
    findings.num_points = num_points
    findings.num_changed = None if own is None else num_changed
    findings.checked("labels", f"{len(codes):,} codes")
    if len(codes) != num_points:
        findings.differs("labels", f"{len(codes):,} codes, the scan has {num_points:,} points")


def _plan(
    old: Columns, new: Columns, before: Scan, is_text: bool, findings: Findings
) -> dict[str, str]:
    """Column of the scan to column of the copy, whose names are printable and differ."""
    findings.checked("columns", f"{sum(1 for _ in flattened(old))} of the scan")
    plan: dict[str, str] = {}
    taken = {"x", "y", "z"}
    for name, _ in flattened(old):
        wanted = unique = _stored(name, is_text)
        number = 1
        while unique in taken:
            number += 1
            unique = f"{wanted}_{number}"
        taken.add(unique)
        if unique in new:
            plan[name] = unique
        else:
            findings.differs("columns", f"{name} is missing")
    rest = [name for name in new if name != "xyz" and name not in plan.values()]
    _check_added(rest, before, findings)
    return plan


def _open_copy(path: Path) -> Scan:
    """What was written: labels that lie beside it are another file's."""
    return open_text(path, beside=False) if path.suffix.lower() in _TEXT else open_columns(path)


def _check_added(names: Sequence[str], before: Scan, findings: Findings) -> None:
    titles = [added_name(name) for name in names]
    for name, title in zip(names, titles, strict=True):
        if title is None and before.complete:
            findings.differs("columns", f"{name} isn't the scan's nor one that labelling adds")
        elif title is not None:
            findings.declared.append(f"{name} added")
    for wanted in ("class_index", "confidence"):
        if wanted not in titles:
            findings.differs("columns", f"{wanted} is missing")


def _stored(name: str, is_text: bool) -> str:
    if is_text:
        name = re.sub(r'[,;"#]', "_", name)
    printable = re.sub(r"[^!-~]+", "_", name)
    return printable if printable.strip("_") else "column"


def _count(scans: tuple[Scan, Scan], findings: Findings) -> None:
    """Say that the numbers of points differ."""
    counts = [sum(len(part["xyz"]) for part in scan.chunks(CHUNK_POINTS)) for scan in scans]
    findings.num_points = counts[0]
    findings.differs(_POINTS, f"{counts[1]:,}, were {counts[0]:,}")
