"""What is written is read back the same, whatever the points and columns."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bushseg import io
from bushseg.io.base import ScanReader
from bushseg.io.memory import MemoryReader
from bushseg.points import PointCloud

DTYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"]
NAMES = ["intensity", "red", "Deviation of X", "gps_time", "label", "x", "é", "a,b"]


@st.composite
def clouds(draw: st.DrawFn) -> PointCloud:
    count = draw(st.integers(1, 8))
    xyz = draw(hnp.arrays(np.float64, (count, 3)))
    names = draw(st.lists(st.sampled_from(NAMES), unique=True, max_size=4))
    attributes = {
        name: draw(hnp.arrays(draw(st.sampled_from(DTYPES)), draw(shapes(count)))) for name in names
    }
    return PointCloud(xyz, attributes)


def shapes(count: int) -> st.SearchStrategy[tuple[int, ...]]:
    return st.sampled_from([(count,), (count, 2)])


def copy(source: ScanReader, path: Path, codes: np.ndarray | None) -> None:
    """Write all chunks, with a column added, as a prediction would."""
    added = {"bush_probability": np.dtype("f4")}
    with io.create(path, io.suffix_of(path), source, added) as writer:
        start = 0
        for chunk in source.chunks(3):
            stop = start + len(chunk)
            probability = np.linspace(0, 1, len(chunk), dtype=np.float32)
            part = None if codes is None else codes[start:stop]
            writer.write(chunk, {"bush_probability": probability}, part)
            start = stop


def flat(points: PointCloud) -> list[np.ndarray]:
    """Columns in order, multi-valued ones split, as tables store them."""
    return [
        column
        for values in points.attributes.values()
        for column in values.reshape(len(values), -1).T
    ]


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".csv", ".txt", ".xyz"])
def test_points_and_columns_survive(suffix: str) -> None:
    @settings(max_examples=60, deadline=None)
    @given(clouds(), st.booleans())
    def check(points: PointCloud, with_codes: bool) -> None:
        with tempfile.TemporaryDirectory() as folder:
            source = MemoryReader(points)
            codes = np.arange(len(points)) - 1 if with_codes else None
            path = Path(folder) / f"out{suffix}"
            copy(source, path, codes)
            back = io.read(path)
        np.testing.assert_array_equal(back.xyz, points.xyz)
        assert len(back.attributes) == len(flat(points)) + 1 + with_codes
        columns = list(back.attributes.values())
        if codes is not None:
            name = "predicted_label" if "label" in list(back.attributes)[:-1] else "label"
            assert list(back.attributes)[-1] == name
            np.testing.assert_array_equal(columns.pop(), codes)
        columns.pop()  # the added column, which the next test checks
        for written, expected in zip(columns, flat(points), strict=True):
            if suffix in (".ply", ".pcd"):
                assert written.dtype == expected.dtype
            np.testing.assert_array_equal(written.astype(expected.dtype), expected)

    check()


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".csv", ".txt"])
def test_added_columns_and_codes(tmp_path: Path, suffix: str) -> None:
    points = PointCloud(np.arange(12.0).reshape(4, 3), {"label": np.array([1, 2, 3, 4])})
    path = tmp_path / f"out{suffix}"
    copy(MemoryReader(points), path, np.array([9, 8, 7, 6]))
    with io.open_scan(path) as scan:
        back = scan.read()
        assert scan.info.label_attribute == "label"
    assert list(back.attributes) == ["label", "bush_probability", "predicted_label"]
    assert back.attributes["label"].tolist() == [1, 2, 3, 4]
    assert back.attributes["predicted_label"].tolist() == [9, 8, 7, 6]
    assert back.attributes["bush_probability"].tolist() == [0, 0.5, 1, 0]


def test_no_name_is_taken_twice(tmp_path: Path) -> None:
    column = np.zeros(1, dtype=np.uint8)
    points = PointCloud(np.ones((1, 3)), {"x": column, "a b": column, "a_b": column})
    path = tmp_path / "out.ply"
    copy(MemoryReader(points), path, None)
    names = list(io.read(path).attributes)
    assert names == ["x_2", "a_b", "a_b_2", "bush_probability"]
