"""What minimum-probability random sampling saves over plain random draws.

    python benchmarks/mrs.py [SCAN] [--voxel-size 0.1] [--crop-points 8192]

Crops: draws until every voxel of the scan has been seen once, how often voxels were seen by then,
and what two passes' worth of draws leave unseen, for MRS (eq. 1-3) and for random centers. Then the
cost of a draw as the scene grows, and of decimation beside plain random. Without SCAN a site is
simulated.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.crops import CropSampler, class_weights, enough_crops
from bushseg.io import open_scan
from bushseg.neighbors import NeighborIndex
from bushseg.sampling import ZetaQueue, decimate, hash_uniform
from bushseg.scan import read_voxels
from bushseg.simulation import SimulateConfig, simulate

SEEDS = 3


class Scene:
    """One tile, all core, without labels (W = 1)."""

    def __init__(self, xyz: NDArray[np.float32]) -> None:
        self.xyz = xyz
        self.is_core = np.ones(len(xyz), dtype=bool)
        self.labels = np.full(len(xyz), -1, dtype=np.int16)


def coverage(scene: Scene, crop_points: int, seed: int, *, mrs: bool) -> tuple[int, float, float]:
    """Draws until all is seen, mean views by then, and the share unseen after two passes' draws."""
    rng = np.random.default_rng(seed)
    size = len(scene.xyz)
    views = np.zeros(size, dtype=np.int64)
    index = NeighborIndex(scene.xyz)
    weights = class_weights(np.zeros(1, dtype=np.int64))
    sampler = CropSampler([size], lambda _: scene, crop_points, weights, rng)
    passes = enough_crops(size, crop_points)
    unseen, draws = 0.0, 0
    while draws < passes or not views.all():
        if mrs:
            indices = sampler.draw().indices
        else:
            indices = index.query(scene.xyz[rng.integers(size)][None], crop_points)[0]
        views[indices] += 1
        draws += 1
        if draws == passes:
            unseen = float(np.mean(views == 0))
    return draws, views.mean(), unseen


def draw_cost(size: int) -> float:
    """Median microseconds to find the smallest zeta and raise 8,192 points around it."""
    rng = np.random.default_rng(0)
    queue = ZetaQueue(size, rng)
    amounts = rng.random(8192)
    times = []
    for _ in range(200):
        begun = time.perf_counter()
        center = queue.smallest()
        low = min(max(center - 4096, 0), size - 8192)
        queue.add(np.arange(low, low + 8192), amounts)
        times.append(time.perf_counter() - begun)
    return float(np.median(times)) * 1e6


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("scan", type=Path, nargs="?")
    parser.add_argument("--voxel-size", type=float, default=0.1)
    parser.add_argument("--crop-points", type=int, default=8192)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = options.scan or simulate(Path(folder), SimulateConfig(seed=1))[0]
        with open_scan(path) as reader:
            voxels = read_voxels(reader, options.voxel_size).voxels
    xyz = (voxels.xyz - voxels.xyz.mean(axis=0)).astype(np.float32)
    least = -(-len(xyz) // options.crop_points)
    print(f"{path.name}: {len(xyz):,} voxels, crops of {options.crop_points:,}; {least} at least")
    print("| centers | draws until all seen | mean views by then | unseen after two passes |")
    print("|---|---|---|---|")
    for name, mrs in (("MRS", True), ("random", False)):
        runs = [coverage(Scene(xyz), options.crop_points, seed, mrs=mrs) for seed in range(SEEDS)]
        draws, views, unseen = (np.median(column) for column in zip(*runs, strict=True))
        print(f"| {name} | {draws:.0f} | {views:.1f} | {unseen:.1%} |")
    print("\n| points | draw and raise, microseconds |\n|---|---|")
    for size in (10**5, 10**6, 10**7):
        print(f"| {size:,} | {draw_cost(size):.0f} |")
    neighbors = NeighborIndex(xyz).query(xyz, 16)
    zeta = hash_uniform(voxels.keys, 0)
    print("\n| decimation to a quarter | seconds | survivors |\n|---|---|---|")
    for sampling in ("mrs", "random"):
        begun = time.perf_counter()
        kept = decimate(zeta, voxels.keys >> 12, 4, xyz, neighbors, sampling)
        print(f"| {sampling} | {time.perf_counter() - begun:.3f} | {len(kept) / len(xyz):.3%} |")


if __name__ == "__main__":
    main()
