"""The figures by which memory, time and disk are estimated (memory.py, room.py, estimates.py).

    python benchmarks/memory.py [--points 8000000] [--model close]

A simulated site is laid side by side until it has so many points, and labelled in a process of its
own: in small and in large tiles, and with so little memory that voxels go to disk.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from scaling import site_copies
from tables import print_table

from bushseg.memory import LEAST
from bushseg.simulation import SimulateConfig, simulate

SMALL, LARGE = 100_000, 1_000_000
"""Voxels a tile."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--points", type=int, default=8_000_000)
    parser.add_argument("--model", default="close")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        simulate(root / "site", SimulateConfig(seed=1))
        scan = root / "scan.las"
        site_copies(next((root / "site").glob("*.la?")), scan, options.points)
        label(scan, root, options.model, "--tile-points", "100000")  # compiles, on a first run
        small, _ = label(scan, root, options.model, "--tile-points", str(SMALL))
        large, _ = label(scan, root, options.model, "--tile-points", str(LARGE))
        least = str(LEAST.num_bytes)
        disk, scratch = label(scan, root, options.model, "--max-memory", least)
    tile = [
        run["passes"] * run["num_voxels"] / num_tiles(run, size)
        for run, size in ((small, SMALL), (large, LARGE))
    ]
    slope = (large["peak_memory"] - small["peak_memory"]) / (tile[1] - tile[0])
    stages = large["stages"]
    points = sum(stages[name] for name in ("read", "sub-sample", "look up", "write"))
    voxels = sum(large["stages"].values()) - points - stages["load the model"]
    print_table(
        f"{large['num_points']:,} points, {large['num_voxels']:,} voxels",
        ["figure", "value"],
        [
            ["bytes a voxel of a tile", f"{slope:.0f}"],
            ["bytes of the program", f"{small['peak_memory'] - slope * tile[0]:,.0f}"],
            ["bytes of scratch a voxel", f"{scratch / disk['num_voxels']:.0f}"],
            [f"peak at {int(least) / 1e9:.2f} GB allowed, GB", f"{disk['peak_memory'] / 1e9:.2f}"],
            ["microseconds a point", f"{points / large['num_points'] * 1e6:.2f}"],
            ["microseconds a voxel", f"{voxels / large['num_voxels'] * 1e6:.2f}"],
        ],
    )


def num_tiles(run: dict[str, Any], tile_points: int) -> int:
    """Tiles of about so many voxels that a scan is cut into: halves until they are small enough."""
    size, count = run["num_voxels"], 1
    while size / count > tile_points:
        count *= 2
    return count


def label(scan: Path, root: Path, model: str, *options: str) -> tuple[dict[str, Any], int]:
    """`bushseg predict` in a process of its own: its result, and the most its files took."""
    program = str(Path(sys.executable).with_name("bushseg"))
    scratch = root / "scratch"
    command = [program, "predict", str(scan), "-o", str(root / "labelled.las"), "--overwrite"]
    command += ["--model", model, "--scratch", str(scratch), "--json", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        most = 0
        while run.poll() is None:
            most = max(most, disk_use(scratch))
            time.sleep(0.1)
        output = run.stdout.read() if run.stdout is not None else ""
    if run.returncode:
        raise SystemExit(f"{' '.join(command)} failed")
    return json.loads(output), most


def disk_use(folder: Path) -> int:
    """Bytes that the files in a folder take."""
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_blocks * 512
        except OSError:  # just removed
            continue
    return total


if __name__ == "__main__":
    main()
