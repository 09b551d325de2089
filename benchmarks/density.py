"""Print how dense real scans are where they are dense, in the middle and where they are sparse.

    python benchmarks/density.py ../shared/data/forest ../shared/data/ign ../shared/data/frames

What bundled models are chosen by (`bushseg/model_choice.py`): distances from a voxel to the last of
its 16 nearest, as quantiles over the scan, in voxels.
"""

import argparse
from pathlib import Path

from bushseg.density import measure_density, sample_points
from bushseg.errors import ReadError
from bushseg.io import find_scans, open_scan
from bushseg.io.kept import KeptReader

NUM_NEIGHBORS = 16


def main() -> None:
    """Measure the scans that are named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", type=Path, nargs="+", help="scans, or folders of them")
    parser.add_argument("--voxel-sizes", type=float, nargs="+", default=[0.1, 0.3])
    arguments = parser.parse_args()
    print(f"{'scan':44} voxel   10 %   50 %   90 %  90 % / 10 %")
    for path in find_scans(arguments.scans):
        try:
            with open_scan(path) as reader:
                xyz = sample_points(KeptReader(reader))
        except ReadError as error:
            print(error)
            continue
        for size in arguments.voxel_sizes:
            found = measure_density(xyz, size, NUM_NEIGHBORS)
            quantiles = (found.near / size, found.median / size, found.far / size)
            print(f"{path.name[:44]:44} {size:5.2f} ", end="")
            print(*(f"{value:6.1f}" for value in quantiles), f"{found.spread:8.1f}")


if __name__ == "__main__":
    main()
