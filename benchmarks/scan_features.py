"""What the network sees of a scan, as distributions that can be compared with another scan's."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from shape_features import metres_above_ground, shapes

import bushseg
from bushseg.neighbors import NeighborIndex
from bushseg.normals import estimate_normals
from bushseg.scan import read_voxels
from bushseg.spf import simple_point_features

NUM_NEIGHBORS = 16
SAMPLE = 30_000
"""Points of a scan whose features are compared."""

Features = Mapping[str, NDArray[np.float32]]
"""Name of a feature to its values."""


def scan_features(path: Path, voxel_size: float, above: float = -np.inf) -> Features:
    """What the network sees of a scan's voxels, of a sample of them.

    Args:
        path: The scan.
        voxel_size: Metres.
        above: Least height above the local ground, metres.

    Returns:
        Name of a feature to its values; "intensity" only where the scan has one.
    """
    with bushseg.open_scan(path) as reader:
        scan = read_voxels(reader, voxel_size)
    xyz = (scan.voxels.xyz - scan.voxels.xyz.mean(axis=0)).astype(np.float32)
    neighbors = NeighborIndex(xyz).query(xyz, NUM_NEIGHBORS)
    # All upwards, whether a sensor is known or not: orientation must not tell two files apart.
    normals = estimate_normals(xyz, neighbors)
    height = metres_above_ground(scan)
    rng = np.random.default_rng(0)
    # Sorted, so that they stand in Morton order and a half of them is a part of the place.
    chosen = np.sort(rng.permutation(np.flatnonzero(height >= above))[:SAMPLE])
    rows = torch.from_numpy(neighbors[chosen].astype(np.int64))
    angles = _angles(torch.from_numpy(xyz), torch.from_numpy(normals), chosen, rows)
    shape = shapes(xyz[chosen], xyz, 4 * voxel_size)
    reach = np.linalg.norm(xyz[neighbors[chosen, -1]] - xyz[chosen], axis=1)
    features = {
        "inclination of normal, degrees": np.degrees(np.arccos(np.clip(normals[chosen, 2], 0, 1))),
        "SPF alpha": angles[:, 0],
        "SPF phi": angles[:, 1],
        "SPF theta, radians": angles[:, 2],
        "distance to 16th neighbor, m": reach,
        "points in a voxel, log2": np.log2(scan.voxels.counts[chosen]),
        "height above ground, m": height[chosen],
        "linearity": shape.linearity,
        "planarity": shape.planarity,
        "scattering": shape.scattering,
    }
    if "intensity" in scan.features:
        features["intensity, scaled"] = scan.features["intensity"][chosen, 0]
    return {name: values.astype(np.float32) for name, values in features.items()}


def _angles(
    xyz: torch.Tensor, normals: torch.Tensor, chosen: NDArray[np.int64], neighbors: torch.Tensor
) -> NDArray[np.float32]:
    """SPF of some points against one neighbor each, the second to the last in turn; (N, 3)."""
    # The chosen points are put in front, so that the function's rows are theirs.
    own = torch.from_numpy(chosen)
    turn = 1 + torch.arange(len(own)) % (neighbors.shape[1] - 1)
    other = neighbors[torch.arange(len(own)), turn]
    places = torch.cat([xyz[own], xyz[other]])
    directions = torch.cat([normals[own], normals[other]])
    rows = torch.arange(len(own), 2 * len(own))[:, None].repeat(2, 1)
    return simple_point_features(places, directions, rows)[: len(own), 0].numpy()
