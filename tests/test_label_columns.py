"""Columns of labels: chosen, and walked side by side. Files are played by arrays in memory."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from bushseg.errors import DataError
from bushseg.io import ScanInfo, ScanReader
from bushseg.label_columns import LabelColumn, in_step, prediction_column, truth_column
from bushseg.labels import SCHEMES
from bushseg.points import FloatArray, PointCloud

BUSH = SCHEMES["bush"]


class Memory(ScanReader):
    """A scan in memory that is read `chunk` points at a time."""

    def __init__(self, xyz: FloatArray, columns: dict[str, NDArray[Any]], chunk: int = 2) -> None:
        self.points, self.chunk = PointCloud(xyz, columns), chunk
        self.info = ScanInfo(
            path=Path("memory.ply"),
            format="memory",
            num_points=len(xyz),
            attributes={name: values.dtype for name, values in columns.items()},
            label_attribute="label" if "label" in columns else None,
        )

    def chunks(self, size: int = 0) -> Iterator[PointCloud]:
        for start in range(0, len(self.points), self.chunk):
            part = slice(start, start + self.chunk)
            columns = {name: values[part] for name, values in self.points.attributes.items()}
            yield PointCloud(self.points.xyz[part], columns)


def line(num_points: int) -> FloatArray:
    """Points a metre apart, far from the origin."""
    return np.arange(num_points)[:, None] * [1.0, 0, 0] + [500_000, 5_400_000, 90]


def walk(ours: Memory, theirs: Memory) -> tuple[list[int], list[int]]:
    pairs = list(in_step(LabelColumn(ours, "label", BUSH), LabelColumn(theirs, "label", BUSH)))
    assert all(len(left) == len(right) == len(sure) > 0 for left, right, sure in pairs)
    return (
        [label for left, _, _ in pairs for label in left.tolist()],
        [label for _, right, _ in pairs for label in right.tolist()],
    )


@given(st.lists(st.sampled_from([2, 4, 5]), max_size=12), st.integers(1, 5), st.integers(1, 5))
def test_blocks_of_any_lengths_are_aligned(codes: Sequence[int], left: int, right: int) -> None:
    label = np.array(codes, np.int64)
    ours = Memory(line(len(codes)), {"label": label}, left)
    theirs = Memory(line(len(codes)), {"label": label[::-1]}, right)
    expected = BUSH.encode(label).labels.tolist()
    assert walk(ours, theirs) == (expected, expected[::-1])


def test_counts_must_agree() -> None:
    label = np.array([2, 4, 4])
    with pytest.raises(DataError, match=r"hold 2 and 3 points; expected the same points"):
        walk(Memory(line(2), {"label": label[:2]}), Memory(line(3), {"label": label}))


@pytest.mark.parametrize(
    ("move", "message"),
    [(0.0009, None), (0.0011, r"point 3 \(from 0\) lies 0\.0011 apart"), (np.inf, "inf apart")],
)
def test_coordinates_must_agree(move: float, message: str | None) -> None:
    label, moved = np.full(5, 2), line(5)
    moved[3, 1] += move
    ours, theirs = Memory(moved, {"label": label}, 2), Memory(line(5), {"label": label}, 3)
    if message is None:
        assert walk(ours, theirs) == ([0] * 5, [0] * 5)
        return
    with pytest.raises(DataError, match=message):
        walk(ours, theirs)


def test_unknown_coordinates_agree_with_any() -> None:
    label = np.full(3, 2)
    nowhere = Memory(np.full((3, 3), np.nan), {"label": label})
    assert walk(nowhere, Memory(line(3), {"label": label})) == ([0] * 3, [0] * 3)


def test_predictions_are_looked_for_where_predict_writes_them() -> None:
    codes = np.array([2])
    columns = {"label": codes, "predicted_label": codes, "class_index": codes}
    for name in ("class_index", "predicted_label", "label"):
        assert prediction_column(Memory(line(1), columns), None, BUSH).name == name
        assert prediction_column(Memory(line(1), columns), "label", BUSH).name == "label"
        assert columns.pop(name) is codes
    with pytest.raises(DataError, match=r"memory\.ply: no column of labels; it has none"):
        prediction_column(Memory(line(1), {}), None, BUSH)


def test_truth_is_the_formats_own_labels() -> None:
    reader = Memory(line(1), {"label": np.array([2]), "class_index": np.array([0])})
    assert truth_column(reader, None, BUSH).name == "label"
    # 2 is ground as a code, and bush as a position.
    assert truth_column(reader, None, BUSH).encode(np.array([2])).tolist() == [0]
    assert truth_column(reader, "class_index", BUSH).encode(np.array([2])).tolist() == [2]


def test_columns_that_hold_no_labels() -> None:
    reader = Memory(line(1), {"name": np.array(["soil"]), "height": np.array([2.0])})
    with pytest.raises(DataError, match="no column 'clss'; name one of name, height"):
        truth_column(reader, "clss", BUSH)
    with pytest.raises(DataError, match="no column of labels; name one of name, height"):
        truth_column(reader, None, BUSH)
    with pytest.raises(DataError, match="'name' has dtype <U4; expected class codes as numbers"):
        truth_column(reader, "name", BUSH)


def test_a_column_of_too_many_values_is_no_class() -> None:
    column = LabelColumn(Memory(line(1), {"time": np.array([0])}), "time", BUSH)
    column.encode(np.arange(60_000))
    with pytest.raises(DataError, match=r"'time' holds more than 65,536 different values"):
        column.encode(np.arange(60_000, 70_000))


@pytest.mark.parametrize("chunk", [2, 7])
def test_confidence_comes_with_class_indices_only(chunk: int) -> None:
    index, sure = np.zeros(5, np.uint8), np.linspace(0, 1, 5, dtype=np.float32)
    columns = {"class_index": index, "label": index + 2, "confidence": sure}
    truth = LabelColumn(Memory(line(5), {"label": index + 2}, 3), "label", BUSH)
    for name, expected in (("class_index", sure), ("label", np.full(5, np.nan))):
        ours = LabelColumn(Memory(line(5), columns, chunk), name, BUSH)
        found = np.concatenate([confidence for _, _, confidence in in_step(ours, truth)])
        np.testing.assert_array_equal(found, expected)
