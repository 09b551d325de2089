"""Does a label depend on where the tiles were cut, or where in the world the scan lies?

    python benchmarks/tiling.py SCAN --model runs/NAME [--tiles 400000,100000] [--halos 32,64,96]

Labels the scan in one piece, then in tiles of several sizes and halos, then moved to x = 6,600,000,
and prints the share of voxels whose label differs, how many of those lie within one meter of a seam
(beside the share of all voxels that do), and the voxels that passed the network per voxel.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.checkpoint import Model, load_model
from bushseg.config import PredictConfig
from bushseg.io import read
from bushseg.io.memory import MemoryReader
from bushseg.labeler import label_tiles
from bushseg.points import PointCloud
from bushseg.runs import find_model
from bushseg.scan import VoxelScan, read_voxels

WHOLE = 20_000_000
SEAM = 1.0


def labels_of(
    model: Model, scan: VoxelScan, tile_points: int, halo: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], float]:
    """Label, tile and passes of every voxel."""
    labels = np.full(len(scan.voxels), -1)
    tiles = np.full(len(scan.voxels), -1)
    seen = 0
    config = PredictConfig(tile_points=tile_points, halo=halo)
    for number, tile in enumerate(label_tiles(model, scan, config)):
        labels[tile.indices] = tile.probabilities.argmax(axis=1)
        tiles[tile.indices] = number
        seen += tile.num_seen
    return labels, tiles, seen / len(labels)


def near_seams(scan: VoxelScan, tiles: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which voxels lie within a metre of another tile, by a raster of half-metre cells."""
    cells = np.floor(scan.voxels.xyz[:, :2] / (SEAM / 2)).astype(np.int64)
    cells -= cells.min(axis=0)
    shape = cells.max(axis=0) + 1
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    np.minimum.at(low, tuple(cells.T), tiles)
    np.maximum.at(high, tuple(cells.T), tiles)
    for _ in range(2):
        padded_low = np.pad(low, 1, constant_values=np.inf)
        padded_high = np.pad(high, 1, constant_values=-np.inf)
        shifts = [(i, j) for i in range(3) for j in range(3)]
        x, y = shape
        low = np.min([padded_low[i : i + x, j : j + y] for i, j in shifts], axis=0)
        high = np.max([padded_high[i : i + x, j : j + y] for i, j in shifts], axis=0)
    return (low != high)[tuple(cells.T)]


def main() -> None:
    """Run the comparison and print it as a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("scan", type=Path)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--tiles", default="400000,100000")
    parser.add_argument("--halos", default="32,64,96")
    options = parser.parse_args()
    model = load_model(find_model(options.model))
    voxel_size = model.card.prepare.voxel_size
    cloud = read(options.scan)
    scan = read_voxels(MemoryReader(cloud), voxel_size)
    whole, _, _ = labels_of(model, scan, WHOLE, 0)
    print(f"{options.scan.name}: {len(cloud):,} points, {len(whole):,} voxels of {voxel_size} m")
    print(
        "| tile, voxels | halo, voxels | tiles | passes | differ | near a seam: differing | all |"
    )
    print("|---|---|---|---|---|---|---|")
    for tile_points in map(int, options.tiles.split(",")):
        for halo in map(int, options.halos.split(",")):
            labels, tiles, passes = labels_of(model, scan, tile_points, halo)
            differs, seam = labels != whole, near_seams(scan, tiles)
            along = seam[differs].mean() if differs.any() else 0.0
            print(
                f"| {tile_points:,} | {halo} | {tiles.max() + 1} | {passes:.2f} | "
                f"{differs.mean():.3%} | {along:.1%} | {seam.mean():.1%} |",
                flush=True,
            )
    moved = PointCloud(cloud.xyz + np.array([6_600_000 - cloud.xyz[0, 0], 0, 0]), cloud.attributes)
    scan = read_voxels(MemoryReader(moved), voxel_size)
    labels, _, _ = labels_of(model, scan, WHOLE, 0)
    if len(labels) != len(whole):
        print(f"moved to x = 6,600,000: {len(labels):,} voxels, not {len(whole):,}")
    else:
        print(f"moved to x = 6,600,000: {(labels != whole).mean():.4%} of labels differ")


if __name__ == "__main__":
    main()
