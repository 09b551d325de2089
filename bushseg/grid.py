"""The voxel grid: a point's voxel follows from its coordinates alone.

Voxel keys are Morton codes, so that sorting by key puts neighbors close in memory, and a label
finds its way back to every raw point by looking the point's key up again.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bushseg.errors import ConfigError

AXIS_BITS = 21
"""Bits a key gives each axis: 2,097,152 voxels, 210 km at a voxel of 0.1 m."""

BLOCK_BITS = 4
BLOCK = 1 << BLOCK_BITS
"""Edge, in voxels, of the cubes that decimation chooses survivors in. Tiles are made of whole ones,
so that no cut changes what survives."""

OUTSIDE = -1
"""The key of a point that has no voxel: not finite, or beyond the grid's reach."""

# A grid line through the first point would put every coordinate that is a multiple of the voxel
# size on a border, where rounding decides. An irrational offset keeps the borders off the lattice
# that stored coordinates lie on, so that a scan moved elsewhere falls into the same voxels.
_OFFSET = 0.6180339887498949


@dataclass(frozen=True, slots=True)
class VoxelGrid:
    """A cubic grid fixed to a scan, not to the world: a moved scan keeps its voxels.

    Attributes:
        origin: Corner of voxel (0, 0, 0) in the scan's coordinates, shape (3,), float64.
        voxel_size: Edge of a voxel in metres.
    """

    origin: NDArray[np.float64]
    voxel_size: float

    @classmethod
    def around(cls, anchor: ArrayLike, voxel_size: float) -> Self:
        """The grid whose middle voxel holds `anchor`, a finite point of the scan, shape (3,)."""
        point = np.asarray(anchor, dtype=np.float64)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ConfigError(f"the grid's anchor is {anchor!r}; expected three finite coordinates")
        return cls(point - (2 ** (AXIS_BITS - 1) + _OFFSET) * voxel_size, voxel_size)

    def keys(self, xyz: NDArray[np.float64]) -> NDArray[np.int64]:
        """Morton key of each point's voxel.

        Args:
            xyz: Coordinates in metres, shape (N, 3), float64.

        Returns:
            Keys, shape (N,), int64; `OUTSIDE` where a point is not finite or out of reach.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            cells = np.floor((xyz - self.origin) / self.voxel_size)
            inside = ((cells >= 0) & (cells < 2**AXIS_BITS)).all(axis=1)
        if inside.all():
            return encode_morton(cells.astype(np.uint64))
        keys = np.full(len(xyz), OUTSIDE, dtype=np.int64)
        keys[inside] = encode_morton(cells[inside].astype(np.uint64))
        return keys


def encode_morton(cells: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Interleave the bits of three indices: z y x, x lowest.

    Args:
        cells: Voxel indices in [0, 2^21), shape (N, 3), uint64.

    Returns:
        Keys, shape (N,), int64, never negative.
    """
    x, y, z = (_spread(cells[:, axis]) for axis in range(3))
    key: NDArray[np.uint64] = x | (y << np.uint64(1)) | (z << np.uint64(2))
    return key.view(np.int64)


def decode_morton(keys: NDArray[np.int64]) -> NDArray[np.int32]:
    """Voxel indices of keys, shape (N, 3), int32: the inverse of :func:`encode_morton`."""
    bits = keys.view(np.uint64)
    return np.stack([_gather(bits >> np.uint64(axis)) for axis in range(3)], axis=1)


# Each step halves the distance that bits still have to travel (or doubles it, going back).
_STEPS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def _spread(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Put two zero bits between the lower 21 bits of each value."""
    spread = values.copy()
    for shift, mask in _STEPS:
        spread |= spread << np.uint64(shift)
        spread &= np.uint64(mask)
    return spread


def _gather(values: NDArray[np.uint64]) -> NDArray[np.int32]:
    """Take every third bit of each value: the inverse of :func:`_spread`."""
    masks = (*(mask for _, mask in reversed(_STEPS)), 2**AXIS_BITS - 1)
    shifts = (0, *(shift for shift, _ in reversed(_STEPS)))
    gathered = values.copy()
    for shift, mask in zip(shifts, masks, strict=True):
        gathered |= gathered >> np.uint64(shift)
        gathered &= np.uint64(mask)
    return gathered.astype(np.int32)
