"""What the comparisons of columns share: names, and the first of what differs."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.verification.las_extras import LABEL_COLUMNS
from bushseg.verification.result import Findings
from bushseg.verification.rows import Columns

CHUNK_POINTS = 250_000
CODES = ("label", "predicted_label")
_ADDED = re.compile(rf"({'|'.join((*LABEL_COLUMNS, *CODES))})(_\d+)?")
_OWN_CODES = ("label", "labels", "class", "classification", "semantic", "category")


@dataclass(slots=True)
class Differences:
    """Points whose values differ, column by column."""

    _found: dict[str, tuple[str, int]] = field(default_factory=dict)

    def compare(
        self, name: str, first: int, now: NDArray[Any], was: NDArray[Any], same: NDArray[np.bool_]
    ) -> None:
        """Note where `same` says no.

        Args:
            name: The column.
            first: Which point the chunk begins with.
            now: The output's values, shape (n,).
            was: The scan's.
            same: Whether they are the same thing.
        """
        wrong = np.flatnonzero(~same)
        if len(wrong):
            at = wrong[0]
            line = f"point {first + at:,}: {name} {now[at]!s}, was {was[at]!s}"
            line, count = self._found.get(name, (line, 0))
            self._found[name] = line, count + len(wrong)

    def report(self, check: str, num_points: int, findings: Findings) -> None:
        """Say what was noted."""
        for line, count in self._found.values():
            findings.differs(check, f"{line} ({count:,} of {num_points:,} points differ)")


def flattened(columns: Columns) -> Iterator[tuple[str, NDArray[Any]]]:
    """Attributes, those of M values a point as M columns NAME_0, NAME_1, ..."""
    for name, values in columns.items():
        if name == "xyz":
            continue
        if values.ndim == 1:
            yield name, values
            continue
        flat = values.reshape(len(values), -1)
        for index in range(flat.shape[1]):
            yield f"{name}_{index}", flat[:, index]


def equal(now: NDArray[Any], was: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether values are the same numbers; NaN is NaN."""
    with np.errstate(invalid="ignore"):
        if was.dtype.kind == "f" and was.dtype.itemsize < 8 and now.dtype == np.float64:
            now = now.astype(was.dtype)  # text of nine digits is a float32 exactly
        same = now == was
        if now.dtype.kind == "f" and was.dtype.kind == "f":
            same |= np.isnan(now) & np.isnan(was)
    return np.asarray(same)


def added_name(name: str) -> str | None:
    """Which of labelling's columns this is, or None."""
    match = _ADDED.fullmatch(name)
    return None if match is None else match[1]


def own_codes(columns: Iterable[str]) -> str | None:
    """The scan's own column of class codes, or None."""
    by_name = {name.lower().removeprefix("scalar_"): name for name in columns}
    return next((by_name[name] for name in _OWN_CODES if name in by_name), None)
