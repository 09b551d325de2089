"""Lookups of whatever numbers a file holds."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from bushseg.codes import UNKNOWN, UnknownCodes, check_labels, look_up
from bushseg.errors import DataError

# Code 0 is unlabelled, 2 is class 0, 300 is class 1; nothing else is known.
TABLE = np.full(65_536, UNKNOWN, np.int16)
TABLE[[0, 2, 300]] = [-1, 0, 1]


def test_small_dtypes() -> None:
    assert look_up(np.array([2, 200], np.uint8), TABLE).unknown == {200: 1}
    assert look_up(np.array([-1, 2], np.int8), TABLE).unknown == {-1: 1}
    assert look_up(np.array([True, False]), TABLE).unknown == {1: 1}


def test_a_short_table() -> None:
    labels, unknown, _ = look_up(np.array([0, 2, 255], np.uint8), TABLE[:3])
    assert labels.tolist() == [-1, 0, -1]
    assert unknown == {255: 1}


def test_what_no_code_can_be() -> None:
    codes = np.array([np.nan, np.inf, -np.inf, 2.5, 1e300, -3.0, 70_000.0, 2.0])
    labels, unknown, invalid = look_up(codes, TABLE)
    assert labels.tolist() == [-1] * 7 + [0]
    assert unknown == {-3: 1, 70_000: 1}
    assert invalid == 5


def test_huge_integers() -> None:
    codes = np.array([2**64 - 1, 2**63, 65_536, 2], dtype=np.uint64)
    labels, unknown, _ = look_up(codes, TABLE)
    assert labels.tolist() == [-1, -1, -1, 0]
    assert unknown == {2**64 - 1: 1, 2**63: 1, 65_536: 1}


def test_nothing() -> None:
    labels, unknown, invalid = look_up(np.empty(0, np.uint8), TABLE)
    assert labels.shape == (0,)
    assert (unknown, invalid) == ({}, 0)


@pytest.mark.parametrize("codes", [np.array(["soil"]), np.array([1j]), np.array([None])])
def test_what_is_no_number_is_refused(codes: NDArray[Any]) -> None:
    with pytest.raises(DataError, match="expected numbers"):
        look_up(codes, TABLE)


def test_several_values_a_point_are_refused() -> None:
    with pytest.raises(DataError, match=r"shape \(2, 3\); expected one a point"):
        look_up(np.zeros((2, 3), np.uint8), TABLE)


_DTYPES = st.sampled_from([np.uint8, np.int8, np.uint16, np.int64, np.uint64, np.float32, float])


@given(hnp.arrays(_DTYPES, st.integers(0, 40)))
def test_any_values_give_what_a_plain_loop_gives(codes: NDArray[Any]) -> None:
    known = {0: -1, 2: 0, 300: 1}
    labels, unknown, invalid = look_up(codes, TABLE)
    assert labels.dtype == np.int16
    assert labels.tolist() == [known.get(code, -1) for code in codes.tolist()]
    num_known = sum(code in known for code in codes.tolist())
    assert num_known + sum(unknown.values()) + invalid == len(codes)


def test_check_labels() -> None:
    check_labels(np.array([-1, 0, 1]), 2)
    check_labels(np.empty(0, np.int16), 2)
    with pytest.raises(DataError, match=r"prediction 2 is no class; expected -1 .. 1"):
        check_labels(np.array([0, 2]), 2, "prediction")
    with pytest.raises(DataError, match="label -2"):
        check_labels(np.array([-2, 0]), 2)


def test_unknown_codes_add_up() -> None:
    unknown = UnknownCodes()
    assert str(unknown) == ""
    unknown.add(look_up(np.array([7, 7, 2, np.nan]), TABLE))
    unknown.add(look_up(np.array([7, 1000]), TABLE))
    assert (unknown.codes, unknown.invalid, unknown.num_points) == ({7: 3, 1000: 1}, 1, 5)
    assert str(unknown) == "7 (3), 1000 (1), no code at all (1)"
    unknown.add(look_up(np.arange(10, 22), TABLE))
    assert "4 more" in str(unknown)
