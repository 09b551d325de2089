"""What minimum-probability random sampling saves over plain random draws.

    python benchmarks/mrs.py [SCAN] [--voxel-size 0.1] [--crop-points 8192]

Crops: draws until every voxel of the scan has been seen once, how often voxels were seen by then,
and what two passes' worth of draws leave unseen, for MRS (eq. 1-3) and for random centers. Then the
cost of a draw as the scene grows. Without SCAN a site is simulated.

Decimation: a rolling surface of 1,000,000 voxels to a quarter, by MRS, by plain random and by
Open3D's farthest_point_down_sample, whose cost grows with the points times the survivors: it is
measured on 20,000 and 40,000 points, and the time for all is worked out from the larger.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.config import Sampling
from bushseg.crops import CropSampler, class_weights, enough_crops
from bushseg.geometry import open3d
from bushseg.grid import BLOCK_BITS, encode_morton
from bushseg.io import open_scan
from bushseg.neighbors import NeighborIndex, nearest
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
    weights = class_weights(np.zeros(1, dtype=np.int64))
    sampler = CropSampler([size], lambda _: scene, crop_points, weights, rng)
    passes = enough_crops(size, crop_points)
    unseen, draws = 0.0, 0
    while draws < passes or not views.all():
        if mrs:
            indices = sampler.draw().indices
        else:
            indices, _ = nearest(scene.xyz, scene.xyz[rng.integers(size)], crop_points)
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


def surface(count: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Keys and positions of so many voxels, one to each column of hilly ground, in Morton order."""
    edge = int(np.ceil(np.sqrt(count)))
    x, y = (each.ravel() for each in np.mgrid[:edge, :edge])
    z = 40 + 20 * np.sin(x / 60) + 20 * np.cos(y / 80)
    keys = encode_morton(np.column_stack([x, y, z]).astype(np.uint64))
    order = np.argsort(keys)[:count]
    jitter = np.random.default_rng(0).random((count, 3))
    return keys[order], (np.column_stack([x, y, z])[order] + jitter).astype(np.float32)


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """Median time of a piece of work, after one run that isn't counted."""
    work()
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        work()
        times.append(time.perf_counter() - begun)
    return float(np.median(times))


def farthest_seconds(count: int) -> float:
    """Seconds that Open3D takes to find the farthest quarter of so many points."""
    library = open3d()
    xyz = surface(count)[1].astype(np.float64)
    cloud = library.geometry.PointCloud(library.utility.Vector3dVector(xyz))
    begun = time.perf_counter()
    cloud.farthest_point_down_sample(count // 4)
    return time.perf_counter() - begun


def compare_decimation(count: int = 1_000_000, repeats: int = 9) -> None:
    """Print what it takes to leave a quarter of so many points."""
    keys, xyz = surface(count)
    neighbors = NeighborIndex(xyz).query(xyz, 16)
    zeta, cells = hash_uniform(keys, 0), keys >> (3 * BLOCK_BITS)

    def choose(sampling: Sampling) -> NDArray[np.int32]:
        return decimate(zeta, cells, 4, xyz, neighbors, sampling)

    draw = median_seconds(lambda: hash_uniform(keys, 0), repeats)
    random = median_seconds(lambda: choose("random"), repeats)
    mrs = median_seconds(lambda: choose("mrs"), repeats)
    rng = np.random.default_rng(0)
    shuffle = median_seconds(lambda: np.sort(rng.permutation(count)[: count // 4]), repeats)
    samples = {size: farthest_seconds(size) for size in (20_000, 40_000)}
    farthest = samples[40_000] * (count / 40_000) ** 2
    print(f"| {count:,} points to a quarter | seconds | to plain random | survivors |")
    print("|---|---|---|---|")
    rows = (
        ("drawing zeta, which both need", draw, None),
        ("plain random: choosing", random, len(choose("random"))),
        ("MRS: choosing", mrs, len(choose("mrs"))),
        ("plain random: drawing and choosing", draw + random, None),
        ("MRS: drawing and choosing", draw + mrs, None),
        ("a shuffle, cut and sorted", shuffle, count // 4),
        ("farthest points (Open3D), worked out", farthest, count // 4),
    )
    for name, seconds, kept in rows:
        survivors = "" if kept is None else f"{kept / count:.3%}"
        print(f"| {name} | {seconds:.4f} | {seconds / random:,.1f} | {survivors} |")
    print(f"\nMRS to plain random, both with their zeta: {(draw + mrs) / (draw + random):.1f}.")
    print(f"Farthest points to MRS: {farthest / (draw + mrs):,.0f}; measured", end="")
    print("".join(f", {size:,} points {took:.2f} s" for size, took in samples.items()))


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
    print()
    compare_decimation()


if __name__ == "__main__":
    main()
