from collections.abc import Callable
from types import ModuleType

import numpy as np

Modules = Callable[[str], ModuleType]


def columns_from(place: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points in columns of one azimuth, and their times."""
    azimuth = np.repeat(np.linspace(0, 2 * np.pi, 500, endpoint=False), 60)
    distance = rng.uniform(1, 25, len(azimuth))
    xyz = np.column_stack([np.cos(azimuth) * distance, np.sin(azimuth) * distance, 0 * distance])
    return xyz + place - [0, 0, 1.7], np.arange(len(azimuth)) / 1000


def test_stations_are_found(benchmark_module: Modules) -> None:
    rng = np.random.default_rng(0)
    places = np.array([[500_010.0, 5_400_020, 251.7], [500_030.0, 5_400_001, 251.7]])
    parts = [columns_from(place, rng) for place in places]
    xyz = np.concatenate([part[0] for part in parts])
    time = np.concatenate([part[1] for part in parts])
    found = benchmark_module("stations").find_stations(xyz, time, np.repeat([1, 2], len(time) // 2))
    assert np.abs(found - places).max() < 0.05


def test_what_moves_has_no_station(benchmark_module: Modules) -> None:
    xyz, time = columns_from(np.zeros(3), np.random.default_rng(0))
    xyz[:, 0] += time * 2
    stations = benchmark_module("stations")
    assert stations.find_stations(xyz, time, np.ones(len(time), int)) is None


def test_a_flight_strip_has_no_station(benchmark_module: Modules) -> None:
    rng = np.random.default_rng(0)
    time = np.arange(20_000) / 1000
    xyz = np.column_stack([rng.uniform(-20, 20, len(time)), time, rng.uniform(0, 5, len(time))])
    stations = benchmark_module("stations")
    assert stations.find_stations(xyz, time, np.ones(len(time), int)) is None
