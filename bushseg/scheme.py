"""What a class scheme is: names for classes, and how codes in files become labels and return.

A *code* is what a file stores (Semantic3D's 4, RELLIS-3D's 19, LAS's 5); a *label* is a class's
position in its scheme, 0 .. C-1, or -1 where a point has none. The network, the metrics and the
cache know labels only. The schemes themselves, and reading a user's own, are in
:mod:`bushseg.labels`.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bushseg.codes import UNKNOWN, UNLABELLED, Encoded, LabelArray, check_labels, look_up
from bushseg.errors import SchemeError

UNLABELLED_INDEX = 255
"""The label -1 in a file's `class_index` column, which is uint8 and has no -1."""

ASPRS_UNCLASSIFIED = 1
"""LAS's "processed, but no class found": what an unlabelled point is written as."""

MAX_CODE = 65_535

Code = Annotated[int, Field(strict=True, ge=0, le=MAX_CODE)]
AsprsCode = Annotated[int, Field(strict=True, ge=0, le=255)]
ClassName = Annotated[str, Field(max_length=64, pattern=r"^\w[\w /.-]*$")]
BushClass = Literal[
    "ground", "low_vegetation", "bush", "tree", "building", "man_made", "vehicle_person"
]
_Number = TypeVar("_Number", np.uint8, np.uint16, np.int16)


class ClassInfo(BaseModel):
    """One class of a scheme."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassName = Field(description="How the class is called in tables, options and files")
    codes: tuple[Code, ...] = Field(
        min_length=1, description="Source codes that mean this class; the first is the one written"
    )
    color: str = Field(
        default="#b4b4b4", pattern=r"^#[0-9a-fA-F]{6}$", description="For plots and viewers"
    )
    asprs: AsprsCode = Field(
        default=ASPRS_UNCLASSIFIED, description="The LAS classification this class is written as"
    )
    bush: BushClass | None = Field(
        default=None, description="The class of the `bush` scheme that holds these points, if any"
    )


class ClassScheme(BaseModel):
    """An ordered set of classes; a class's label is its position."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassName = Field(description="How the scheme is called")
    description: str = Field(default="", description="What it is for, in a line")
    classes: tuple[ClassInfo, ...] = Field(
        min_length=1, max_length=UNLABELLED_INDEX, description="The classes, in the labels' order"
    )
    unlabelled: tuple[Code, ...] = Field(
        default=(0,), min_length=1, description="Codes that mean no label; the first is written"
    )
    bush_class: str | None = Field(default=None, description="The class that is bush, if any")

    @model_validator(mode="after")
    def _check_unique(self) -> Self:
        owners = dict.fromkeys(self.unlabelled, "unlabelled (by default [0])")
        seen: set[str] = set()
        for info in self.classes:
            if info.name.casefold() in seen:
                raise ValueError(f"two classes are named {info.name!r}; give each its own name")
            seen.add(info.name.casefold())
            for code in info.codes:
                if code in owners:
                    raise ValueError(
                        f"code {code} stands in {owners[code]} and in {info.name!r}; "
                        "leave it in one of them"
                    )
                owners[code] = repr(info.name)
        if self.bush_class is not None and self.bush_class not in self.names:
            raise ValueError(
                f"bush_class {self.bush_class!r} is no class here; name one of "
                f"{', '.join(self.names)}"
            )
        return self

    @property
    def num_classes(self) -> int:
        """How many classes there are, C."""
        return len(self.classes)

    @property
    def names(self) -> tuple[str, ...]:
        """The classes' names, in the labels' order."""
        return tuple(info.name for info in self.classes)

    @property
    def colors(self) -> NDArray[np.uint8]:
        """The classes' colors as red, green, blue, shape (C, 3), uint8."""
        digits = "".join(info.color[1:] for info in self.classes)
        return np.frombuffer(bytes.fromhex(digits), dtype=np.uint8).reshape(-1, 3)

    @property
    def bush_index(self) -> int | None:
        """The label of the class that is bush, or None."""
        return None if self.bush_class is None else self.names.index(self.bush_class)

    def encode(self, codes: NDArray[Any]) -> Encoded:
        """Turn source codes into labels.

        Args:
            codes: Shape (N,), any numeric dtype. Whatever a file may hold is taken: codes that are
                unknown, negative, huge or not whole become -1 and are counted.

        Raises:
            DataError: The codes aren't numbers.
        """
        return look_up(codes, self._labels_by_code)

    def decode(self, labels: NDArray[np.integer[Any]]) -> NDArray[np.uint16]:
        """Turn labels into the source codes to write, shape (N,), uint16.

        Raises:
            DataError: A label is outside -1 .. C-1.
        """
        codes = [info.codes[0] for info in self.classes]
        return self._gather(codes, self.unlabelled[0], labels, np.uint16)

    def encode_indices(self, values: NDArray[Any]) -> Encoded:
        """Turn a file's `class_index` column into labels; 255 is unlabelled.

        Takes and reports the same as :meth:`encode`.
        """
        table = np.full(UNLABELLED_INDEX + 1, UNKNOWN, dtype=np.int16)
        table[: self.num_classes] = np.arange(self.num_classes)
        table[UNLABELLED_INDEX] = UNLABELLED
        return look_up(values, table)

    def decode_indices(self, labels: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
        """Turn labels into a `class_index` column, shape (N,), uint8; -1 becomes 255.

        Raises:
            DataError: A label is outside -1 .. C-1.
        """
        return self._gather(range(self.num_classes), UNLABELLED_INDEX, labels, np.uint8)

    def to_asprs(
        self, labels: NDArray[np.integer[Any]], mapping: Mapping[str, int] | None = None
    ) -> NDArray[np.uint8]:
        """Turn labels into LAS classification codes; -1 becomes 1, unclassified.

        Args:
            labels: Shape (N,), any integer dtype.
            mapping: Class name to code, for classes to be written otherwise than the scheme says.

        Returns:
            Codes, shape (N,), uint8. Point formats 0-5 can't hold those above 31: see
            :func:`bushseg.labels.fit_legacy`.

        Raises:
            SchemeError: The mapping names a class the scheme lacks, or a code outside 0 .. 255.
            DataError: A label is outside -1 .. C-1.
        """
        codes = {info.name: info.asprs for info in self.classes}
        for name, code in (mapping or {}).items():
            if name not in codes:
                raise SchemeError(
                    f"{name!r} is no class of scheme {self.name!r}; name one of "
                    f"{', '.join(self.names)}"
                )
            if not 0 <= code <= 255:
                raise SchemeError(f"ASPRS code {code} for {name!r}; expected one in 0 .. 255")
            codes[name] = code
        return self._gather(list(codes.values()), ASPRS_UNCLASSIFIED, labels, np.uint8)

    def translate(
        self, labels: NDArray[np.integer[Any]], target: "ClassScheme"
    ) -> NDArray[np.int16]:
        """Turn labels into another scheme's, by way of the `bush` classes they stand for.

        A class goes to the one class of `target` with the same `bush` equivalent; where several
        have it, to the one of its own name. A point whose class has no such counterpart becomes
        -1: unlabelled is honest, a guess is not. Between equal schemes nothing changes.

        Raises:
            DataError: A label is outside -1 .. C-1.
        """
        counterparts = [
            index if target == self else target._counterpart(info)
            for index, info in enumerate(self.classes)
        ]
        return self._gather(counterparts, UNLABELLED, labels, np.int16)

    def _counterpart(self, info: ClassInfo) -> int:
        """The label here of another scheme's class, or -1."""
        if info.bush is None:
            return UNLABELLED
        found = [label for label, own in enumerate(self.classes) if own.bush == info.bush]
        if len(found) > 1:
            found = [label for label in found if self.classes[label].name == info.name]
        return found[0] if found else UNLABELLED

    @cached_property
    def _labels_by_code(self) -> LabelArray:
        """The label of every possible code, shape (65536,)."""
        table = np.full(MAX_CODE + 1, UNKNOWN, dtype=np.int16)
        table[list(self.unlabelled)] = UNLABELLED
        for label, info in enumerate(self.classes):
            table[list(info.codes)] = label
        return table

    def _gather(
        self,
        values: Sequence[int],
        unlabelled: int,
        labels: NDArray[np.integer[Any]],
        dtype: type[_Number],
    ) -> NDArray[_Number]:
        """Give each label its value."""
        check_labels(labels, self.num_classes)
        # The unlabelled value comes last, where index -1 finds it.
        return np.array([*values, unlabelled], dtype=dtype).take(labels)
