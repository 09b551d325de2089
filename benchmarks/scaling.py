"""How time and memory of `predict`, or of `prepare`, grow with the scan.

    python benchmarks/scaling.py [--points 100000,1000000,10000000] [--voxel-size 0.1] [--repeats 3]
        [--model close] [--max-memory 2GB] [--prepare]

A simulated site is laid side by side until it has so many points, and labelled by a model of
random weights (time does not depend on them) or the one named, each run in a process of its own.
Prints the medians, and the exponent of time against points from the first size to the last. With
--prepare it is prepared for training instead. With --max-memory, the command is told so and the
system refuses the process more memory of its own than that (RLIMIT_DATA): one that took more would
fail.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import laspy
import numpy as np
from open3d_ml_ours import model_at

from bushseg.memory import parse_size, peak_memory
from bushseg.simulation import SimulateConfig, simulate


def site_copies(site: Path, output: Path, num_points: int) -> None:
    """Write the first points of as many copies of a site, on a square, as hold so many."""
    source = laspy.read(site)
    extent = np.ceil(np.max(source.header.maxs[:2] - source.header.mins[:2])) + 1
    step = round(float(extent / source.header.scales[0]))
    columns = int(np.ceil(np.sqrt(num_points / len(source.points))))
    header = laspy.LasHeader(point_format=source.header.point_format, version="1.4")
    header.scales, header.offsets = source.header.scales, source.header.offsets
    with laspy.open(output, mode="w", header=header) as writer:
        left, number = num_points, 0
        while left > 0:
            points = source.points[: min(left, len(source.points))].copy()
            points["X"] = points["X"] + step * (number % columns)
            points["Y"] = points["Y"] + step * (number // columns)
            writer.write_points(points)
            left, number = left - len(points), number + 1


def label(scan: Path, *, model: Path | str, max_memory: str | None = None) -> dict[str, float]:
    """`bushseg predict` in a process of its own: its result."""
    with tempfile.TemporaryDirectory() as folder:
        output = str(Path(folder, "labelled.las"))
        return run(["predict", str(scan), "-o", output, "--model", str(model)], max_memory)


def prepare(scan: Path, *, voxel_size: float, max_memory: str | None = None) -> dict[str, float]:
    """`bushseg prepare` in a process of its own: its result, and the most memory it had."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["prepare", str(scan), "-o", folder, "--voxel-size", str(voxel_size)]
        return run(command, max_memory)


def run(arguments: list[str], max_memory: str | None) -> dict[str, float]:
    """A `bushseg` command in a process of its own: its result, and the most memory it had."""
    command = [str(Path(sys.executable).with_name("bushseg")), *arguments, "--json"]
    if max_memory is not None:
        limit = ["prlimit", f"--data={parse_size(max_memory)}"]
        command = [*limit, *command, "--max-memory", max_memory]
    with tempfile.TemporaryFile("w+") as output:
        peak = 0
        with subprocess.Popen(command, stdout=output) as process:
            while process.poll() is None:
                peak = max(peak, peak_memory(process.pid) or 0)
                time.sleep(0.02)
        if process.returncode:
            raise SystemExit(f"{' '.join(command)} failed")
        output.seek(0)
        result: dict[str, float] = json.load(output)
    return result | {"peak_memory": peak}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--points", default="100000,1000000,10000000")
    parser.add_argument("--voxel-size", type=float, default=0.1)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--model", help="instead of one of random weights")
    parser.add_argument("--max-memory", help="memory to keep within, such as 2GB")
    parser.add_argument("--prepare", action="store_true", help="prepare instead of labelling")
    parser.add_argument("--json", type=Path, help="write the last run's result there")
    options = parser.parse_args()
    sizes = [int(size) for size in options.points.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        simulate(root / "site", SimulateConfig(seed=1))
        site = next((root / "site").glob("*.la?"))
        measured = partial(prepare, voxel_size=options.voxel_size)
        if not options.prepare:
            model = options.model or model_at(options.voxel_size, root, None)
            measured = partial(label, model=model)
        scans = []
        for size in sizes:
            scans.append(root / f"{size}.las")
            site_copies(site, scans[-1], size)
        measured(site)  # loads what the first run of an installation compiles
        work = "crops" if options.prepare else "passes"
        print(f"| points | voxels | {work} | s | points/s | peak GB |")
        print("|---:|---:|---:|---:|---:|---:|")
        seconds = []
        for size, scan in zip(sizes, scans, strict=True):
            runs = [measured(scan, max_memory=options.max_memory) for _ in range(options.repeats)]
            seconds.append(float(np.median([run["seconds"] for run in runs])))
            done = f"{runs[0]['num_crops']:,}" if options.prepare else f"{runs[0]['passes']:.2f}"
            peak = max(run["peak_memory"] for run in runs)
            print(
                f"| {size:,} | {runs[0]['num_voxels']:,} | {done} "
                f"| {seconds[-1]:.2f} | {size / seconds[-1]:,.0f} | {peak / 1e9:.2f} |",
                flush=True,
            )
    if options.json is not None:
        options.json.write_text(json.dumps(runs[-1], indent=1) + "\n", "utf-8")
    if len(sizes) > 1:
        exponent = np.log(seconds[-1] / seconds[0]) / np.log(sizes[-1] / sizes[0])
        print(f"\nTime grows with the power {exponent:.2f} of the points.")


if __name__ == "__main__":
    main()
