from collections.abc import Callable
from types import ModuleType

import numpy as np

Modules = Callable[[str], ModuleType]


def test_strokes_label_so_many_points_and_half_of_them_bush(benchmark_module: Modules) -> None:
    fine_tuning = benchmark_module("fine_tuning")
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 10, (20_000, 3))
    labels = np.where(xyz[:, 0] < 1, 2, 0).astype(np.int16)
    labels[:100] = -1
    kept, number = fine_tuning.strokes(xyz, labels, 300, seed=1)
    assert len(kept) == len(np.unique(kept)) == 300
    assert (labels[kept] >= 0).all()
    assert 0.2 < (labels[kept] == 2).mean() < 0.8
    assert number > 5
    again, _ = fine_tuning.strokes(xyz, labels, 300, seed=1)
    assert (again == kept).all()


def test_all_points_can_be_painted(benchmark_module: Modules) -> None:
    fine_tuning = benchmark_module("fine_tuning")
    xyz, labels = np.zeros((5, 3)), np.array([2, 2, 0, -1, 0], np.int16)
    kept, _ = fine_tuning.strokes(xyz, labels, 1000, seed=0)
    assert sorted(kept.tolist()) == [0, 1, 2, 4]
