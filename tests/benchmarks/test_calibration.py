from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

Modules = Callable[[str], ModuleType]


def test_five_points(benchmark_module: Modules) -> None:
    found = benchmark_module("calibration").reliability(
        np.array([0.05, 0.15, 0.9, 0.95, 1.0], np.float32),
        np.array([False, True, True, True, False]),
        num_bins=10,
    )
    assert found.counts.tolist() == [1, 1, 0, 0, 0, 0, 0, 0, 0, 3]
    assert found.accuracy[9] == pytest.approx(2 / 3)
    assert found.confidence[9] == pytest.approx(0.95)
    assert np.isnan(found.accuracy[5])
    assert found.ece == pytest.approx((0.05 + 0.85 + 3 * (0.95 - 2 / 3)) / 5)
