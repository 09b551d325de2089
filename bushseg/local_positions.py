"""Positions near a tile's origin, in float32 without loss.

Rounded to a power of two, at most one voxel over `STEPS`: far below what a scanner resolves. Up to
2^24 steps from an origin that lies on the same lattice float32 holds them exactly, and so all
differences between them: which neighbor is nearer doesn't depend on the tile they are seen in.
"""

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.parallel import for_chunks

STEPS = 1024
_CHUNK = 65_536  # voxels a thread takes at a time


def local_positions(
    xyz: NDArray[np.float64], indices: NDArray[np.int64], voxel_size: float
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Positions of some voxels on the lattice, from an origin in their middle that lies on it.

    Args:
        xyz: Positions of all voxels, metres, shape (N, 3), float64.
        indices: Which voxels, shape (M,), int64.
        voxel_size: Metres.

    Returns:
        Metres from the origin, shape (M, 3), float32; and the origin, shape (3,), float64.
    """
    step = 2.0 ** np.floor(np.log2(voxel_size / STEPS))
    middle = np.rint(_mean_position(xyz, indices) / step)
    local = np.empty((len(indices), 3), dtype=np.float32)
    for_chunks(
        lambda start, stop: _localize(xyz, indices, step, middle, local, start, stop),
        len(indices),
        _CHUNK,
    )
    return local, middle * step


@compiled
def _mean_position(xyz: NDArray[np.float64], indices: NDArray[np.int64]) -> NDArray[np.float64]:
    total = np.zeros(3)
    for index in indices:
        for axis in range(3):
            total[axis] += xyz[index, axis]
    return total / len(indices)


@compiled
def _localize(
    xyz: NDArray[np.float64],
    indices: NDArray[np.int64],
    step: float,
    middle: NDArray[np.float64],
    local: NDArray[np.float32],
    start: int,
    stop: int,
) -> None:
    """Positions of voxels start to stop, in metres from `middle`, which counts steps."""
    for i in range(start, stop):
        for axis in range(3):
            local[i, axis] = (np.rint(xyz[indices[i], axis] / step) - middle[axis]) * step
