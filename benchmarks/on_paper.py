"""What larger scans would take, worked out from the stages of one that was labelled.

    bushseg predict SCAN.las -o OUT.las --max-memory 2GB --json > run.json
    python benchmarks/on_paper.py run.json [--points 1000000000,10000000000] [--workers 1,100]

Every stage is taken to grow with the points, as `benchmarks/scaling.py` finds; a worker is a
machine like that of the run. Of one scan the workers label tiles, and reading, ground, look-up and
writing are left to the command itself; of a folder of many scans each worker does whole ones.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from tables import print_table

from bushseg.room import SCRATCH_VOXEL

BY_TILE = ("neighbors", "decimation", "normals", "network")
"""Stages that a worker does with the tile it labels."""


def main() -> None:
    """Work it out and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("run", type=Path, help="what `bushseg predict --json` printed")
    parser.add_argument("--points", default="1000000000,10000000000")
    parser.add_argument("--workers", default="1,100")
    options = parser.parse_args()
    run = json.loads(options.run.read_text("utf-8"))
    tile, rest = seconds_per_point(run)
    print(
        f"{run['num_points']:,} points in {run['seconds']:,.0f} s: {tile * 1e6:.2f} microseconds a "
        f"point in tiles, {rest * 1e6:.2f} in the rest"
    )
    rows = []
    for points in map(int, options.points.split(",")):
        for workers in map(int, options.workers.split(",")):
            one = points * (tile / workers + rest) / 3600
            many = points * (tile + rest) / workers / 3600
            scratch = SCRATCH_VOXEL * points * run["num_voxels"] / run["num_points"]
            rows.append([points, workers, f"{one:.1f}", f"{many:.2f}", f"{scratch / 1e9:,.0f}"])
    print_table(
        "On paper",
        ["points", "workers", "one scan, h", "many scans, h", "scratch of one scan, GB"],
        rows,
    )
    print(
        f"\nHowever many workers label its tiles, one scan takes {rest * 1e6:.2f} s a million "
        f"points; that is {(tile + rest) / rest:.1f} times as fast as one worker."
    )


def seconds_per_point(run: dict[str, Any]) -> tuple[float, float]:
    """Seconds a point that go by tile, and those of all other stages."""
    stages: dict[str, float] = run["stages"]
    tile = sum(stages.get(name, 0.0) for name in BY_TILE)
    return tile / run["num_points"], (run["seconds"] - tile) / run["num_points"]


if __name__ == "__main__":
    main()
