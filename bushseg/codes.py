"""Looking up class codes, whatever numbers a file holds.

A *code* is what a file stores for a class; a *label* is the class's position in a scheme, or -1.
Columns of codes come in any dtype and with any content: the lookup never indexes out of range and
says what it did not find.
"""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import DataError

UNLABELLED = -1
"""The label of a point that has none; ignored in training and evaluation."""

UNKNOWN = -2
"""In a lookup table, what stands at codes that no class has; never among labels."""

LabelArray = NDArray[np.int16]

_LARGEST_EXACT_FLOAT = 2.0**53


class Encoded(NamedTuple):
    """Codes turned into labels, and what could not be.

    Attributes:
        labels: Shape (N,), int16; -1 where the code means no label or isn't known.
        unknown: Each whole number that is no code of the scheme, to how many points hold it.
        invalid: How many values can't be a code at all: fractions, NaN, floats beyond 2^53.
    """

    labels: LabelArray
    unknown: dict[int, int]
    invalid: int


@dataclass
class UnknownCodes:
    """What a whole column held that its scheme doesn't know.

    Attributes:
        codes: Each unknown code, to how many points hold it.
        invalid: How many values can't be a code at all, such as NaN.
    """

    codes: dict[int, int] = field(default_factory=dict)
    invalid: int = 0

    @property
    def num_points(self) -> int:
        """How many points hold something unknown."""
        return sum(self.codes.values()) + self.invalid

    def add(self, encoded: Encoded) -> None:
        """Count what one more lookup didn't find."""
        for code, count in encoded.unknown.items():
            self.codes[code] = self.codes.get(code, 0) + count
        self.invalid += encoded.invalid

    def __str__(self) -> str:
        most = sorted(self.codes.items(), key=lambda item: -item[1])
        parts = [f"{code} ({count:,})" for code, count in most[:10]]
        if len(most) > 10:
            parts.append(f"{len(most) - 10} more")
        if self.invalid:
            parts.append(f"no code at all ({self.invalid:,})")
        return ", ".join(parts)


def look_up(values: NDArray[Any], table: LabelArray) -> Encoded:
    """Look each value up in a table of labels, whatever the values are.

    Args:
        values: Shape (N,), any numeric dtype.
        table: The label of each code from 0 on, :data:`UNKNOWN` where there is none; int16.

    Raises:
        DataError: The values aren't numbers, or not one a point.
    """
    kind = values.dtype.kind
    if kind not in "buif":
        raise DataError(f"class codes have dtype {values.dtype}; expected numbers")
    if values.ndim != 1:
        raise DataError(f"class codes have shape {values.shape}; expected one a point")
    whole = np.ones(len(values), dtype=np.bool_)
    if kind == "u" and np.iinfo(values.dtype).max < len(table):
        labels = table[values]
    else:
        if kind == "f":
            values = values.astype(np.float64, copy=False)
            whole = (np.abs(values) <= _LARGEST_EXACT_FLOAT) & (values == np.floor(values))
        inside = whole & (values >= 0) & (values < len(table))
        labels = np.full(len(values), UNKNOWN, dtype=np.int16)
        labels[inside] = table[values[inside].astype(np.intp)]
    strange = labels == UNKNOWN
    if not strange.any():
        return Encoded(labels, {}, 0)
    labels[strange] = UNLABELLED
    found, counts = np.unique(values[strange & whole], return_counts=True)
    unknown = {int(code): int(count) for code, count in zip(found, counts, strict=True)}
    return Encoded(labels, unknown, int(np.count_nonzero(~whole)))


def check_labels(labels: NDArray[np.integer[Any]], num_classes: int, what: str = "label") -> None:
    """Refuse labels that no scheme of `num_classes` classes has.

    Args:
        labels: Any shape and integer dtype.
        num_classes: How many classes there are, C.
        what: What the values are, for the message.

    Raises:
        DataError: A value is outside -1 .. C-1.
    """
    if labels.size and not (labels.min() >= UNLABELLED and labels.max() < num_classes):
        wrong = labels.min() if labels.min() < UNLABELLED else labels.max()
        raise DataError(f"{what} {wrong} is no class; expected -1 .. {num_classes - 1}")
