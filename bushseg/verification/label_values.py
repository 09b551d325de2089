"""Whether a copy's labels can be what labelling writes, and how many class codes it changed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.verification.result import Findings

UNLABELLED_INDEX = 255
_CHECK = "labels"


class LabelValues:
    """Looks at labels, chunk by chunk.

    `class_index` must be a class, all points of one class must have one code (unless the codes
    are the scan's own, kept), and shares must lie within 0 and 1.

    Args:
        num_classes: How many classes there are; None where that isn't known.
    """

    def __init__(self, num_classes: int | None) -> None:
        self._num_classes = num_classes
        self._num_points = 0
        self._num_changed = 0
        # By class_index: its code and the first point that has it.
        self._codes = np.full(256, -1, np.int64)
        self._firsts = np.full(256, -1, np.int64)
        self._lines: dict[str, tuple[str, int]] = {}
        self._contradiction: tuple[str, int] | None = None
        self._names: set[str] = set()

    def add(
        self,
        before: NDArray[Any] | None,
        after: NDArray[Any] | None,
        columns: Mapping[str, NDArray[Any]],
    ) -> None:
        """Look at one chunk.

        Args:
            before: The scan's class codes, shape (n,), or None.
            after: The copy's, or None.
            columns: Its label columns.
        """
        self._names |= set(columns)
        if before is not None and after is not None:
            self._num_changed += int(np.count_nonzero(before != after))
        for name, values in columns.items():
            if name == "class_index":
                most = UNLABELLED_INDEX if self._num_classes is None else self._num_classes - 1
                self._count(name, values, (values > most) & (values != UNLABELLED_INDEX))
            else:
                self._count(name, values, ~((values >= 0) & (values <= 1)))
        num_seen = len(next(iter(columns.values()), np.empty(0)))
        if after is not None and "class_index" in columns:
            self._compare_codes(columns["class_index"].astype(np.int64), after.astype(np.int64))
        self._num_points += num_seen

    def report(self, findings: Findings, *, has_codes: bool) -> None:
        """Say what was seen.

        Args:
            findings: Told.
            has_codes: Whether class codes could be compared with the scan's.
        """
        if has_codes:
            findings.num_changed = self._num_changed
        if not self._names:
            return
        names = [n for n in ("class_index", "confidence", "bush_probability") if n in self._names]
        findings.checked(_CHECK, ", ".join(names))
        for line, count in self._lines.values():
            findings.differs(_CHECK, f"{line} ({count:,} points)")
        if self._contradiction is not None and (self._num_changed or not has_codes):
            line, count = self._contradiction
            findings.differs(_CHECK, f"{line} ({count:,} points)")

    def _compare_codes(self, index: NDArray[np.int64], codes: NDArray[np.int64]) -> None:
        for value in np.unique(index).tolist():
            if self._codes[value] < 0:
                first = int(np.argmax(index == value))
                self._codes[value], self._firsts[value] = codes[first], self._num_points + first
        wrong = np.flatnonzero(self._codes[index] != codes)
        if not len(wrong):
            return
        at = wrong[0]
        line = (
            f"point {self._num_points + at:,}: class code {codes[at]} for class_index {index[at]}, "
            f"but {self._codes[index[at]]} at point {self._firsts[index[at]]:,}"
        )
        before = self._contradiction or (line, 0)
        self._contradiction = before[0], before[1] + len(wrong)

    def _count(self, name: str, values: NDArray[Any], wrong: NDArray[np.bool_]) -> None:
        found = np.flatnonzero(wrong)
        if len(found):
            at = found[0]
            line = f"point {self._num_points + at:,}: {name} {values[at]}"
            first, count = self._lines.get(name, (line, 0))
            self._lines[name] = first, count + len(found)
