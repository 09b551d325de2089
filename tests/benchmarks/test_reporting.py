from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from bushseg.errors import DataError
from bushseg.points import PointCloud

Modules = Callable[[str], ModuleType]
BUSH, TREE = 2, 3


class ByHeight:
    """Ground below half a metre, bush above."""

    name = "by height"

    def label(self, scan: object) -> np.ndarray:
        found = np.zeros((len(scan.cloud), 7), np.float32)
        low = scan.cloud.xyz[:, 2] < 0.5
        found[low, 0] = found[~low, BUSH] = 1
        return found


def write_frame(path: Path, codes: tuple[int, int]) -> None:
    """A flat ground and a block a metre above it, with their codes."""
    steps = np.arange(-5, 5, 0.5)
    xy = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) + 0.1
    ground = np.column_stack([xy, np.full(len(xy), 0.01), np.zeros(len(xy))])
    block = ground[(np.abs(xy) < 2).all(axis=1)] + [0, 0, 1, 0]
    path.parent.mkdir(parents=True, exist_ok=True)
    np.concatenate([ground, block]).astype("<f4").tofile(path)
    np.repeat(codes, [len(ground), len(block)]).astype("<u4").tofile(path.with_suffix(".label"))


def test_report_of_real_and_simulated_frames(
    benchmark_module: Modules, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_frame(tmp_path / "frames" / "seq00_000000.bin", (40, 70))
    write_frame(tmp_path / "orchard" / "site_000.bin", (2, 5))
    reporting = benchmark_module("reporting")
    result = reporting.report([ByHeight()], tmp_path, [tmp_path / "orchard"], [])
    figures = result.as_dict()["by height"]
    assert figures["frames: IoU of vegetation"] == figures["frames: IoU of ground"] == 1
    assert figures["orchard: IoU of bush"] == figures["all simulated: IoU of tree"] == 0
    assert figures["all simulated: IoU of building"] is None
    summary = capsys.readouterr().out.split("### Summary")[1]
    assert summary.index("orchard: IoU of bush") < summary.index("frames: IoU of ground")


def test_nothing_to_judge_by(benchmark_module: Modules, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no scan to judge by"):
        benchmark_module("reporting").report([ByHeight()], tmp_path, [], [])


def test_what_is_hidden(benchmark_module: Modules) -> None:
    judging = benchmark_module("judging")
    seen: list[list[str]] = []

    class Watcher:
        name = "watcher"

        def label(self, scan: object) -> np.ndarray:
            seen.append(sorted(scan.cloud.attributes))
            return np.zeros((1, 7), np.float32)

    names = ("red", "green", "blue", "intensity", "gps_time")
    cloud = PointCloud(np.zeros((1, 3)), {name: np.zeros(1) for name in names})
    scan = judging.Scan(Path("a.laz"), cloud, np.zeros(1, int), None, None)
    for hidden in (["rgb"], ["intensity"], ["rgb", "intensity"]):
        judging.Without(Watcher(), hidden).label(scan)
    assert seen == [["gps_time", "intensity"], ["blue", "gps_time", "green", "red"], ["gps_time"]]
    with pytest.raises(DataError, match="choose rgb or intensity"):
        judging.Without(Watcher(), ["height"])
