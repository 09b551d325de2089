"""What larger scans would take."""

from collections.abc import Callable
from types import ModuleType

import pytest


def test_what_goes_by_tile_and_what_does_not(
    benchmark_module: Callable[[str], ModuleType],
) -> None:
    stages = {"read": 2.0, "neighbors": 1.0, "network": 5.0, "write": 1.0}
    run = {"num_points": 4, "seconds": 10.0, "stages": stages}
    assert benchmark_module("on_paper").seconds_per_point(run) == pytest.approx((1.5, 1.0))
