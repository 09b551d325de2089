"""How many voxels a scan has, counted in little memory.

Of all voxels a share is kept that is fixed by a hash of their keys, and halved whenever it becomes
too much: exact for small scans, within about a tenth of a percent for large ones.
"""

import numpy as np
from numpy.typing import NDArray

from bushseg.grid import OUTSIDE, VoxelGrid

_MOST_KEYS = 1 << 20
_MIX = np.uint64(0x9E3779B97F4A7C15)  # odd, so no two keys become one


class VoxelCounter:
    """Counts the voxels of points that arrive in chunks.

    Args:
        grid: The grid.
    """

    def __init__(self, grid: VoxelGrid) -> None:
        self._grid = grid
        self._halvings = 0
        self._kept = np.empty(0, np.uint64)

    def add(self, xyz: NDArray[np.float64]) -> None:
        """Count a chunk of points in, shape (N, 3), float64; those without a voxel are passed."""
        keys = self._grid.keys(xyz)
        hashed = keys[keys != OUTSIDE].astype(np.uint64) * _MIX
        self._kept = np.unique(np.concatenate([self._kept, self._share(hashed)]))
        while len(self._kept) > _MOST_KEYS:
            self._halvings += 1
            self._kept = self._share(self._kept)

    @property
    def count(self) -> int:
        """Voxels so far, about."""
        return len(self._kept) << self._halvings

    def _share(self, hashed: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Those that are kept."""
        return hashed[hashed <= np.uint64(2**64 - 1) >> np.uint64(self._halvings)]
