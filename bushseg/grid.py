"""The voxel grid: a point's voxel follows from its coordinates alone.

Voxel keys are Morton codes, so that sorting by key puts neighbors close in memory, and a label
finds its way back to every raw point by looking the point's key up again.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bushseg.compiled import compiled
from bushseg.errors import ConfigError
from bushseg.parallel import for_chunks

AXIS_BITS = 21
"""Bits a key gives each axis: 2,097,152 voxels, 210 km at a voxel of 0.1 m."""

BLOCK_BITS = 4
BLOCK = 1 << BLOCK_BITS
"""Edge, in voxels, of the cubes that decimation chooses survivors in. Tiles are made of whole ones,
so that no cut changes what survives."""

OUTSIDE = -1
"""The key of a point that has no voxel: not finite, or beyond the grid's reach."""

_CHUNK = 65_536  # points a thread takes at a time

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
        """The grid whose middle voxel holds `anchor`, finite and amid the scan, shape (3,)."""
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
        keys, xyz = np.empty(len(xyz), dtype=np.int64), np.ascontiguousarray(xyz)
        for_chunks(
            lambda start, stop: _find_keys(xyz, self.origin, self.voxel_size, keys, start, stop),
            len(xyz),
            _CHUNK,
        )
        return keys


def encode_morton(cells: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Interleave the bits of three indices: z y x, x lowest.

    Args:
        cells: Voxel indices in [0, 2^21), shape (N, 3), uint64.

    Returns:
        Keys, shape (N,), int64, never negative.
    """
    keys = np.empty(len(cells), dtype=np.int64)
    _encode(np.ascontiguousarray(cells), keys)
    return keys


def decode_morton(keys: NDArray[np.int64]) -> NDArray[np.int32]:
    """Voxel indices of keys, shape (N, 3), int32: the inverse of :func:`encode_morton`."""
    cells = np.empty((len(keys), 3), dtype=np.int32)
    for_chunks(lambda start, stop: _decode(keys, cells, start, stop), len(keys), _CHUNK)
    return cells


@compiled
def _find_keys(
    xyz: NDArray[np.float64],
    origin: NDArray[np.float64],
    voxel_size: float,
    keys: NDArray[np.int64],
    start: int,
    stop: int,
) -> None:
    """Keys of points start to stop."""
    end = float(2**AXIS_BITS)
    for i in range(start, stop):
        x = np.floor((xyz[i, 0] - origin[0]) / voxel_size)
        y = np.floor((xyz[i, 1] - origin[1]) / voxel_size)
        z = np.floor((xyz[i, 2] - origin[2]) / voxel_size)
        if 0 <= x < end and 0 <= y < end and 0 <= z < end:  # not so for NaN
            keys[i] = _interleave(np.uint64(x), np.uint64(y), np.uint64(z))
        else:
            keys[i] = OUTSIDE


@compiled
def _encode(cells: NDArray[np.uint64], keys: NDArray[np.int64]) -> None:
    for i in range(len(cells)):
        keys[i] = _interleave(cells[i, 0], cells[i, 1], cells[i, 2])


@compiled
def _decode(keys: NDArray[np.int64], cells: NDArray[np.int32], start: int, stop: int) -> None:
    for i in range(start, stop):
        for axis in range(3):
            cells[i, axis] = _gather(np.uint64(keys[i]) >> np.uint64(axis))


@compiled
def _interleave(x: np.uint64, y: np.uint64, z: np.uint64) -> np.int64:
    return np.int64(_spread(x) | _spread(y) << np.uint64(1) | _spread(z) << np.uint64(2))


@compiled
def _spread(bits: np.uint64) -> np.uint64:
    """Put two zero bits between the lower 21 bits; each step halves how far they have to go."""
    bits = (bits | bits << np.uint64(32)) & np.uint64(0x1F00000000FFFF)
    bits = (bits | bits << np.uint64(16)) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | bits << np.uint64(8)) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | bits << np.uint64(4)) & np.uint64(0x10C30C30C30C30C3)
    return (bits | bits << np.uint64(2)) & np.uint64(0x1249249249249249)


@compiled
def _gather(bits: np.uint64) -> np.uint64:
    """Take every third bit: the inverse of :func:`_spread`."""
    bits = bits & np.uint64(0x1249249249249249)
    bits = (bits | bits >> np.uint64(2)) & np.uint64(0x10C30C30C30C30C3)
    bits = (bits | bits >> np.uint64(4)) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | bits >> np.uint64(8)) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | bits >> np.uint64(16)) & np.uint64(0x1F00000000FFFF)
    return (bits | bits >> np.uint64(32)) & np.uint64(2**AXIS_BITS - 1)
