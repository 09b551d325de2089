"""Codes to labels and back, whatever a file holds."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from pydantic import ValidationError

from bushseg.errors import DataError, SchemeError
from bushseg.scheme import ClassInfo, ClassScheme

HEDGES = ClassScheme(
    name="hedges",
    classes=(
        ClassInfo(name="soil", codes=(2, 9), color="#010203", asprs=2, bush="ground"),
        ClassInfo(name="hedge", codes=(300,), color="#a0b0c0", asprs=4, bush="bush"),
        ClassInfo(name="wall", codes=(7,), asprs=64, bush="man_made"),
    ),
    unlabelled=(0, 1),
    bush_class="hedge",
)


def test_names_colors_and_bush() -> None:
    assert HEDGES.num_classes == 3
    assert HEDGES.names == ("soil", "hedge", "wall")
    assert HEDGES.bush_index == 1
    assert HEDGES.colors.dtype == np.uint8
    assert HEDGES.colors.tolist() == [[1, 2, 3], [160, 176, 192], [180, 180, 180]]
    assert HEDGES.model_copy(update={"bush_class": None}).bush_index is None


@pytest.mark.parametrize("dtype", ["u2", "i2", "i4", "u4", "i8", "u8", "f4", "f8", ">i4", ">f8"])
def test_encode_in_every_dtype(dtype: str) -> None:
    codes = np.array([2, 9, 300, 7, 0, 1, 5, 5], dtype=dtype)
    labels, unknown, invalid = HEDGES.encode(codes)
    assert labels.dtype == np.int16
    assert labels.tolist() == [0, 0, 1, 2, -1, -1, -1, -1]
    assert unknown == {5: 2}
    assert invalid == 0


def test_decode_writes_the_first_code() -> None:
    codes = HEDGES.decode(np.array([0, 1, 2, -1], np.int16))
    assert codes.dtype == np.uint16
    assert codes.tolist() == [2, 300, 7, 0]


@given(hnp.arrays(np.int16, st.integers(0, 40), elements=st.integers(-1, 2)))
def test_labels_survive_their_codes(labels: NDArray[np.int16]) -> None:
    assert HEDGES.encode(HEDGES.decode(labels)).labels.tolist() == labels.tolist()
    assert HEDGES.encode_indices(HEDGES.decode_indices(labels)).labels.tolist() == labels.tolist()


@pytest.mark.parametrize("label", [-2, 3, 255])
def test_a_label_outside_the_scheme_is_refused(label: int) -> None:
    labels = np.array([0, label])
    for call in (HEDGES.decode, HEDGES.decode_indices, HEDGES.to_asprs):
        with pytest.raises(DataError, match=rf"label {label} is no class; expected -1 .. 2"):
            call(labels)


def test_indices() -> None:
    indices = HEDGES.decode_indices(np.array([2, -1]))
    assert indices.dtype == np.uint8
    assert indices.tolist() == [2, 255]
    labels, unknown, invalid = HEDGES.encode_indices(np.array([0, 2, 255, 3, 256, -1, 0.5]))
    assert labels.tolist() == [0, 2, -1, -1, -1, -1, -1]
    assert unknown == {-1: 1, 3: 1, 256: 1}
    assert invalid == 1


def test_to_asprs() -> None:
    labels = np.array([0, 1, 2, -1])
    assert HEDGES.to_asprs(labels).dtype == np.uint8
    assert HEDGES.to_asprs(labels).tolist() == [2, 4, 64, 1]
    assert HEDGES.to_asprs(labels, {"hedge": 3}).tolist() == [2, 3, 64, 1]
    assert HEDGES.to_asprs(np.empty(0, np.int16)).shape == (0,)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"shrub": 3}, "'shrub' is no class of scheme 'hedges'; name one of soil, hedge, wall"),
        ({"hedge": 256}, "ASPRS code 256 for 'hedge'"),
        ({"hedge": -1}, "ASPRS code -1 for 'hedge'"),
    ],
)
def test_to_asprs_refuses_a_wrong_mapping(mapping: dict[str, int], message: str) -> None:
    with pytest.raises(SchemeError, match=message):
        HEDGES.to_asprs(np.array([0]), mapping)


def test_translate_goes_by_equivalents() -> None:
    other = ClassScheme(
        name="other",
        classes=(
            ClassInfo(name="road", codes=(1,), bush="ground"),
            ClassInfo(name="soil", codes=(2,), bush="ground"),
            ClassInfo(name="fence", codes=(3,), bush="man_made"),
            ClassInfo(name="mixed", codes=(4,)),
        ),
    )
    # Of two grounds, soil goes to its namesake; a hedge has no counterpart.
    labels = HEDGES.translate(np.array([0, 1, 2, -1]), other)
    assert labels.dtype == np.int16
    assert labels.tolist() == [1, -1, 2, -1]
    assert other.translate(np.array([0, 1, 2, 3]), HEDGES).tolist() == [0, 0, 2, -1]


def test_translate_never_guesses() -> None:
    two_grounds = ClassScheme(
        name="two",
        classes=(
            ClassInfo(name="road", codes=(1,), bush="ground"),
            ClassInfo(name="field", codes=(2,), bush="ground"),
        ),
    )
    assert HEDGES.translate(np.array([0]), two_grounds).tolist() == [-1]
    assert two_grounds.translate(np.array([0, 1]), two_grounds).tolist() == [0, 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unlabelled": (2,)}, "code 2 stands in unlabelled"),
        ({"bush_class": "shrub"}, "bush_class 'shrub' is no class here"),
        ({"classes": ()}, "at least 1"),
        ({"unlabelled": ()}, "at least 1"),
        ({"classes": HEDGES.classes * 2}, "two classes are named 'soil'"),
    ],
)
def test_a_malformed_scheme_is_refused(change: dict[str, Any], message: str) -> None:
    fields = {name: getattr(HEDGES, name) for name in ClassScheme.model_fields}
    with pytest.raises(ValidationError, match=message):
        ClassScheme(**{**fields, **change})


def test_more_classes_than_a_file_can_index_are_refused() -> None:
    classes = tuple(ClassInfo(name=f"c{i}", codes=(i + 1,)) for i in range(256))
    assert ClassScheme(name="most", classes=classes[:255]).num_classes == 255
    with pytest.raises(ValidationError, match="at most 255"):
        ClassScheme(name="too many", classes=classes)


@pytest.mark.parametrize(
    "change",
    [
        {"codes": (65_536,)},
        {"codes": (-1,)},
        {"codes": (True,)},
        {"codes": (2.0,)},
        {"codes": ()},
        {"color": "red"},
        {"color": "#12345"},
        {"asprs": 256},
        {"bush": "shrub"},
        {"name": ""},
        {"name": "a=b"},
        {"name": "two\nlines"},
        {"height": 2},
    ],
)
def test_a_malformed_class_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        ClassInfo(**{"name": "x", "codes": (2,), **change})
