from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

Modules = Callable[[str], ModuleType]


@pytest.fixture
def realism(benchmark_module: Modules) -> ModuleType:
    return benchmark_module("realism")


def test_distance_ratio_and_merit(realism: ModuleType) -> None:
    real = [{"a": np.array([0.0, 1.0])}, {"a": np.array([1.0, 2.0])}]
    rows = realism.compare([{"a": np.array([3.0, 4.0])}], real, one_place=False)
    (row,) = rows
    unit = np.std([0, 1, 1, 2])
    assert row.yard == pytest.approx(1 / unit)
    assert row.distance == pytest.approx(2.5 / unit)
    assert row.ratio == pytest.approx(2.5)
    assert realism.merit(rows) == pytest.approx(2.5)


def test_what_one_scan_lacks_is_not_compared(realism: ModuleType) -> None:
    one, two = {"a": np.zeros(4), "b": np.zeros(4)}, {"a": np.ones(4)}
    assert [row.name for row in realism.compare([two], [one, one], one_place=False)] == ["a"]


def test_halves_are_the_yardstick_of_one_place(realism: ModuleType) -> None:
    (row,) = realism.compare(
        [{"a": np.array([0.0, 1.0])}], [{"a": np.array([0.0, 1.0])}], one_place=True
    )
    assert row.yard == pytest.approx(2)
    assert row.distance == 0


def test_kinds_are_sorted(realism: ModuleType) -> None:
    assert set(realism.by_kind(["tls=a", "tls=b", "uav=c"])) == {"tls", "uav"}
    with pytest.raises(SystemExit, match="expected KIND=SCANS"):
        realism.by_kind(["scans"])


def test_features_of_a_flat_ground(benchmark_module: Modules, tmp_path: object) -> None:
    path = tmp_path / "flat.txt"
    xy = np.stack(np.meshgrid(np.arange(40), np.arange(40)), axis=-1).reshape(-1, 2) * 0.2
    np.savetxt(
        path, np.column_stack([xy, np.zeros(len(xy))]), fmt="%.3f", header="x y z", comments=""
    )
    features = benchmark_module("scan_features").scan_features(path, 0.1)
    assert np.abs(features["inclination of normal, degrees"]).max() < 0.1
    assert np.median(features["planarity"]) > 0.5
    assert features["SPF phi"] == pytest.approx(0, abs=1e-4)
    assert features["height above ground, m"] == pytest.approx(0, abs=1e-4)
