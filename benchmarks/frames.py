"""How long one LiDAR frame takes, from an array in memory to labels, once everything is warm.

    python benchmarks/frames.py [FRAME ...] [--model runs/NAME] [--voxel-size 0.1] [--runs 30]

Without a frame, one of a simulated 64-beam LiDAR is taken; without a model, one of random weights:
time does not depend on them. The model is loaded once, as a robot would; every run is one call of
`bushseg.predict`. The first call (Open3D's import, compiled loops from disk, threads) is printed by
itself, two more are not counted. `--profile` adds where the first frame's time goes, by function.
"""

import argparse
import cProfile
import pstats
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from open3d_ml_ours import model_at

import bushseg
from bushseg.checkpoint import Model, load_model
from bushseg.io.memory import MemoryReader
from bushseg.parallel import num_workers
from bushseg.runs import find_model
from bushseg.scan import read_voxels
from bushseg.simulation import SimulateConfig, simulate

WARM_UP = 2
PACKAGE = Path(bushseg.__file__).parent


def model_for(voxel_size: float | None, source: Path | None) -> Model:
    """The model asked for, at the voxel size asked for: its own or 0.1 m if none."""
    if source is not None and voxel_size is None:
        return load_model(find_model(source))
    with tempfile.TemporaryDirectory() as folder:
        return load_model(model_at(voxel_size or 0.1, Path(folder), source))


def time_calls(call: Callable[[], object], runs: int) -> tuple[float, NDArray[np.float64]]:
    """Seconds of the first call, and of each of `runs` warm ones."""
    times = []
    for _ in range(1 + WARM_UP + runs):
        begun = time.perf_counter()
        call()
        times.append(time.perf_counter() - begun)
    return times[0], np.array(times[1 + WARM_UP :])


def print_profile(call: Callable[[], object], runs: int, least: float = 0.01) -> None:
    """Print what bushseg's functions take, with all they call, where it is 1 % or more."""
    profile = cProfile.Profile()
    profile.enable()
    for _ in range(runs):
        call()
    profile.disable()
    functions = pstats.Stats(profile).stats  # (file, line, name): (_, calls, own, with callees, _)
    total = max(seconds for _, _, _, seconds, _ in functions.values())
    print("\n| function | calls a frame | s a frame | of which its own |\n|---|---|---|---|")
    for (file, _, name), (_, count, own, seconds, _) in sorted(
        functions.items(), key=lambda item: -item[1][3]
    ):
        if Path(file).is_relative_to(PACKAGE) and seconds >= least * total:
            module = Path(file).relative_to(PACKAGE).with_suffix("")
            print(
                f"| {module}: {name} | {count / runs:.0f} | {seconds / runs:.3f} "
                f"| {own / runs:.3f} |"
            )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("frames", type=Path, nargs="*")
    parser.add_argument("--model", type=Path, help="a model or a run")
    parser.add_argument("--voxel-size", type=float, help="metres; the model's, or 0.1")
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    model = model_for(options.voxel_size, options.model)
    voxel_size = model.card.prepare.voxel_size
    calls = {}
    with tempfile.TemporaryDirectory() as folder:
        spinning = SimulateConfig(seed=1, sensor={"kind": "spinning"})
        paths = options.frames or simulate(Path(folder), spinning)
        for path in paths:
            with bushseg.open_scan(path) as reader:
                cloud, sensor = reader.read(), reader.info.sensor_position
            voxels = read_voxels(MemoryReader(cloud, sensor), voxel_size).voxels
            calls[path.name, len(cloud), len(voxels)] = lambda cloud=cloud, sensor=sensor: (
                bushseg.predict(cloud, model, sensor=sensor)
            )
    print(f"{num_workers()} cores, voxels of {voxel_size} m, {options.runs} runs")
    print("| frame | points | voxels | first, s | p50, s | p95, s | points/s |")
    print("|---|---|---|---|---|---|---|")
    for (name, num_points, num_voxels), call in calls.items():
        first, times = time_calls(call, options.runs)
        middle, high = np.quantile(times, (0.5, 0.95))
        print(
            f"| {name} | {num_points:,} | {num_voxels:,} | {first:.2f} | {middle:.3f} "
            f"| {high:.3f} | {num_points / middle:,.0f} |",
            flush=True,
        )
    if options.profile:
        print_profile(next(iter(calls.values())), options.runs)


if __name__ == "__main__":
    main()
