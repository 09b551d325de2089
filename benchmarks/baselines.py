"""The obvious alternatives to a network, fitted on the same sites and judged by the same code.

    python benchmarks/baselines.py ../shared/data --train SITES ... [--simulated TEST_SITES ...]
        [--voxel-size 0.1] [--model runs/NAME ...] [--intensity] [--only frames,ign,...]

A height-above-ground band, its edges fitted for the best bush IoU; and a random forest on
eigenvalue features at three scales, density and height. With `--model` the networks stand in the
same tables.
"""

import argparse
import time
from pathlib import Path

from alternatives import Forest, HeightBand, read_training
from judging import Labeler, Network
from reporting import report
from tables import print_table

from bushseg.io import find_scans


def main() -> None:
    """Fit, judge and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder of the real scans")
    parser.add_argument("--train", type=Path, nargs="+", required=True, help="labelled sites")
    parser.add_argument(
        "--simulated", type=Path, nargs="+", default=[], help="simulated scans, or their folders"
    )
    parser.add_argument("--voxel-size", type=float, help="metres; the first model's, or 0.1")
    parser.add_argument("--model", action="append", default=[], help="one, or a run")
    parser.add_argument("--intensity", action="store_true", help="tell the forest the intensity")
    parser.add_argument("--trees", type=int, default=100)
    parser.add_argument("--per-class", type=int, default=20_000, help="voxels it learns from")
    parser.add_argument("--only", default="", help="frames, ign, odm, vle, simulated; all")
    options = parser.parse_args()
    networks = [Network(source) for source in options.model]
    size = options.voxel_size or (networks[0].known[0].card.prepare.voxel_size if networks else 0.1)
    begun = time.perf_counter()
    scans = [read_training(path, size) for path in find_scans(options.train)]
    band = HeightBand.fit(scans, size)
    forest = Forest(
        scans,
        size,
        intensity=options.intensity,
        per_class=options.per_class,
        num_trees=options.trees,
    )
    grass, low, high = band.edges
    print(
        f"{len(scans)} sites, voxels of {size} m, fitted in {time.perf_counter() - begun:.0f} s; "
        f"grass from {grass:.2f} m, bush from {low:.2f} to {high:.2f} m above ground"
    )
    del scans
    print_table("What the forest goes by", ["feature", "importance"], forest.importances()[:10])
    labelers: list[Labeler] = [*networks, forest, band]
    only = [name for name in options.only.split(",") if name]
    report(labelers, options.data, options.simulated, only)
    print(f"\n{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
