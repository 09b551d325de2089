from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from bushseg.points import PointCloud

Modules = Callable[[str], ModuleType]
GROUND, LOW, BUSH, TREE, BUILDING = range(5)


def one_hot(labels: list[int]) -> np.ndarray:
    return np.eye(7, dtype=np.float32)[labels]


@pytest.fixture
def judging(benchmark_module: Modules) -> ModuleType:
    return benchmark_module("judging")


@pytest.fixture
def scoring(benchmark_module: Modules) -> ModuleType:
    return benchmark_module("scoring")


def scan_of(judging: ModuleType, codes: list[int], xyz: np.ndarray | None = None) -> object:
    if xyz is None:
        xyz = np.arange(len(codes))[:, None] * np.array([1.0, 0.0, 0.0])
    cloud = PointCloud(xyz)
    stations = np.zeros((1, 3))
    return judging.Scan(Path("a.laz"), cloud, np.array(codes), None, stations)


def test_columns_are_height_density_and_range(judging: ModuleType) -> None:
    xyz = np.array([[0.0, 0, 0], [0.01, 0, 0], [3, 0, 0], [3, 0, 4]])
    judged = judging.Judged.from_probabilities(
        one_hot([0, 0, 0, 2]), scan_of(judging, [2, 2, 2, 4], xyz)
    )
    assert judged.columns["density"].tolist() == [2, 2, 1, 1]
    assert judged.columns["range"].tolist() == pytest.approx([0, 0.01, 3, 5])
    assert judged.columns["height"][3] == pytest.approx(4, abs=0.5)


def test_points_that_are_none_are_left_out(judging: ModuleType) -> None:
    probabilities = one_hot([0, 2, 0])
    probabilities[2] = 0
    judged = judging.Judged.from_probabilities(probabilities, scan_of(judging, [-1, 4, 2]))
    assert judged.codes.tolist() == [4, 2]
    assert judged.predictions.tolist() == [2, -1]


def test_groups_of_a_real_source(
    judging: ModuleType, scoring: ModuleType, benchmark_module: Modules
) -> None:
    ign = benchmark_module("real_scans").SOURCES["ign"]
    # Under half a metre the survey's vegetation may be grass; higher up it may not.
    codes, said = [2, 2, 3, 4, 5, 6, 1], [LOW, BUSH, LOW, LOW, BUSH, BUILDING, TREE]
    judged = judging.Judged.from_probabilities(one_hot(said), scan_of(judging, codes))
    counts = scoring.group_confusion(judged, ign).counts
    expected = np.zeros((5, 5), int)
    expected[0, :2] = 1  # ground: grass is right, bush is not
    expected[1, :2] = 1, 2
    expected[2, 2] = 1
    assert counts.tolist() == expected.tolist()


def test_classes_of_a_simulated_scan(judging: ModuleType, scoring: ModuleType) -> None:
    judged = judging.Judged.from_probabilities(
        one_hot([BUSH, BUSH, TREE, BUSH]), scan_of(judging, [4, 5, 5, 1])
    )
    confusion = scoring.class_confusion(judged)
    assert confusion.iou[BUSH] == 0.5
    assert confusion.iou[TREE] == 0.5


def test_bush_by_range(judging: ModuleType, scoring: ModuleType) -> None:
    xyz = np.array([[1.0, 0, 0], [2, 0, 0], [12, 0, 0], [13, 0, 0]])
    judged = judging.Judged.from_probabilities(
        one_hot([BUSH, TREE, BUSH, BUSH]), scan_of(judging, [4, 4, 4, 5], xyz)
    )
    rows = scoring.bush_by_band(judged, "range")
    assert [str(row[0]) for row in rows] == [
        "to 5",
        "5 to 10",
        "10 to 20",
        "20 to 40",
        "40 and more",
    ]
    assert rows[0][1:] == (2, 1.0, 0.5, 0.5)
    assert rows[2][1:] == (1, 0.5, 1.0, 0.5)
    assert rows[4][1] == 0
    assert np.isnan(rows[4][2:]).all()


def test_shares_count_points_without_a_label(judging: ModuleType, scoring: ModuleType) -> None:
    shares = scoring.shares(np.array([2, 2, 3, -1], np.int16))
    assert shares.tolist() == [0, 0, 0.5, 0.25, 0, 0, 0]
    assert np.isnan(scoring.shares(np.empty(0, np.int16))).all()
