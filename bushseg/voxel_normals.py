"""Normals of all voxels of a scan, each estimated once, whatever tiles they are cut into later."""

import numpy as np
from numpy.typing import NDArray

from bushseg.local_positions import local_positions
from bushseg.neighbors import NeighborIndex, reaches
from bushseg.normals import estimate_normals
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.tiling import Tiling

_TILE_POINTS = 500_000
_HALO = 48  # voxels


def voxel_normals(
    scan: VoxelScan, num_neighbors: int, stages: Stages
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Estimate the normals of a scan's voxels.

    Done in large pieces, so that memory doesn't grow with the scan. Around a piece lie voxels to
    find neighbors among, which get their own normals in their own piece.

    Args:
        scan: The scan's voxels.
        num_neighbors: K.
        stages: Told of the time that tiling, neighbors and normals take.

    Returns:
        Unit normals, shape (N, 3), float32; and the distance to the K-th neighbor, metres, shape
        (N,), float32.
    """
    voxels = scan.voxels
    normals = voxels.scratch.empty("normals", (len(voxels), 3), np.float32)
    distances = voxels.scratch.empty("distances", (len(voxels),), np.float32)
    with stages.timed("tiling"):
        tiling = Tiling(voxels.keys, _TILE_POINTS, _HALO, voxels.scratch)
    for tile in tiling.tiles:
        with stages.timed("tiling"):
            indices, is_core = tiling.members(tile)
            xyz, origin = local_positions(voxels.xyz, indices, voxels.grid.voxel_size)
        core = indices[is_core]
        with stages.timed("neighbors"):
            neighbors = NeighborIndex(xyz).query(xyz[is_core], num_neighbors)
            distances[core] = reaches(xyz, neighbors)
        with stages.timed("normals"):
            sensor = None if scan.sensor is None else scan.sensor - origin
            normals[core] = estimate_normals(xyz, neighbors, sensor)
        voxels.scratch.release()
    return normals, distances
