from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

Modules = Callable[[str], ModuleType]


@pytest.fixture
def shape_features(benchmark_module: Modules) -> ModuleType:
    return benchmark_module("shape_features")


def grid(*axes: np.ndarray) -> np.ndarray:
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)


def middle(shape: object, name: str) -> float:
    values = getattr(shape, name)
    return float(values[len(values) // 2])


def test_a_line_a_wall_and_a_cube(shape_features: ModuleType) -> None:
    steps, one = np.arange(-5, 6) * 0.1, np.zeros(1)
    line, wall, cube = grid(steps, one, one), grid(steps, one, steps), grid(steps, steps, steps)
    shapes = [shape_features.shapes(xyz, xyz, 0.25) for xyz in (line, wall, cube)]
    assert middle(shapes[0], "linearity") == pytest.approx(1, abs=1e-4)
    assert middle(shapes[1], "planarity") == pytest.approx(1, abs=1e-4)
    assert middle(shapes[1], "verticality") == pytest.approx(1, abs=1e-4)
    assert middle(shapes[2], "scattering") > 0.7
    assert middle(shapes[0], "number") == 5
    assert middle(shapes[0], "spread") == 0
    assert middle(shapes[1], "spread") == pytest.approx(0.4, abs=1e-5)


def test_a_lone_point_has_no_shape(shape_features: ModuleType) -> None:
    xyz = np.array([[0, 0, 0], [9, 0, 0]], np.float32)
    shape = shape_features.shapes(xyz, xyz, 0.5)
    for name in ("linearity", "planarity", "scattering", "variation", "spread"):
        assert getattr(shape, name).tolist() == [0, 0]
    assert shape.number.tolist() == [1, 1]


def test_coarse_positions_stay_where_they_were(shape_features: ModuleType) -> None:
    xyz = np.random.default_rng(0).uniform([1000, 2000, 30], [1004, 2004, 34], (500, 3))
    found = shape_features.coarse(xyz, 100.0)
    assert len(found) <= 8
    fine = shape_features.coarse(xyz, 0.01)
    local = (xyz - xyz.mean(axis=0)).astype(np.float32)
    order = [np.lexsort(points.round(4).T) for points in (fine, local)]
    assert np.allclose(fine[order[0]], local[order[1]], atol=1e-3)
