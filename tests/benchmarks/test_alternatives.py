from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("sklearn", reason="scikit-learn is in the extra [bench]")

Modules = Callable[[str], ModuleType]


def test_best_band(benchmark_module: Modules) -> None:
    heights = np.array([0.0, 0.1, 0.52, 1.0, 1.9, 2.6, 7], np.float32)
    is_bush = np.array([False, False, True, True, True, False, False])
    low, high = benchmark_module("alternatives").best_band(heights, is_bush)
    assert 0.1 < low <= 0.52
    assert 1.9 < high <= 2.6


def test_best_cut(benchmark_module: Modules) -> None:
    heights = np.array([0.0, 0.02, 0.3, 0.2, 0.4, 0.5], np.float32)
    is_above = np.array([False, False, False, True, True, True])
    cut = benchmark_module("alternatives").best_cut(heights, is_above)
    assert 0.02 < cut <= 0.2


def test_forest_and_band_label_every_point(benchmark_module: Modules, tmp_path: object) -> None:
    from bushseg.simulation import SimulateConfig, simulate

    alternatives, judging = benchmark_module("alternatives"), benchmark_module("judging")
    path = simulate(tmp_path, SimulateConfig(size=20, seed=3))[0]
    scans = [alternatives.read_training(path, 0.3)]
    band = alternatives.HeightBand.fit(scans, 0.3)
    forest = alternatives.Forest(scans, 0.3, per_class=500, num_trees=10)
    scan = judging.read_scan(path)
    for labeler in (band, forest):
        found = labeler.label(scan)
        assert found.shape == (len(scan.cloud), 7)
        assert np.allclose(found.sum(axis=1), 1, atol=1e-5)
    own = benchmark_module("scoring").class_confusion(judging.Judged.of(forest, scan))
    assert own.oa > 0.8
    assert forest.importances()[0][1] > 0.05
