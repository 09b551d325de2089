"""A tile, cut out of a scan and ready for the network: local coordinates, normals, pyramid."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.config import Sampling
from bushseg.normals import estimate_normals
from bushseg.parallel import for_chunks
from bushseg.pyramid import Pyramid, build_pyramid
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.tiling import Tile, Tiling

_CHUNK = 65_536  # voxels a thread takes at a time
_STEPS = 1024
"""Positions are rounded to a power of two, at most one voxel over this many: far below what a
scanner resolves. Up to 2^24 steps from a tile's origin float32 then holds them exactly, and so all
differences between them: which neighbor is nearer doesn't depend on the tile they are seen in."""


class PyramidSettings(Protocol):
    """The settings a pyramid depends on; PrepareConfig has them."""

    @property
    def num_neighbors(self) -> int:
        """K."""

    @property
    def num_levels(self) -> int:
        """How many times to decimate."""

    @property
    def decimation(self) -> int:
        """One point in this many survives."""

    @property
    def sampling(self) -> Sampling:
        """How survivors are chosen."""

    @property
    def seed(self) -> int:
        """Selects decimation's zeta."""


@dataclass(frozen=True, slots=True)
class TileData:
    """The voxels of a tile's core and halo, in Morton order.

    Attributes:
        origin: The tile's origin in the scan's coordinates, (3,) float64.
        indices: Each voxel's index in the scan's voxels, (N,) int64.
        is_core: Whether a voxel belongs to the core, (N,) bool.
        keys: Voxel keys, (N,) int64.
        xyz: Metres from `origin`, (N, 3) float32.
        normals: Unit normals, (N, 3) float32.
        features: Feature name to (N, columns) float32.
        labels: Class index; -1 for unlabelled and for all of the halo, (N,) int16.
        counts: Raw points in the voxel, (N,) int32.
        pyramid: Indices of all levels.
    """

    origin: NDArray[np.float64]
    indices: NDArray[np.int64]
    is_core: NDArray[np.bool_]
    keys: NDArray[np.int64]
    xyz: NDArray[np.float32]
    normals: NDArray[np.float32]
    features: Mapping[str, NDArray[np.float32]]
    labels: NDArray[np.int16]
    counts: NDArray[np.int32]
    pyramid: Pyramid

    def __len__(self) -> int:
        return len(self.xyz)

    def neighbor_distance(self) -> float:
        """Median distance to the farthest of the K neighbors, metres: the tile's density."""
        return float(np.median(_reaches(self.xyz, self.pyramid.neighbors[0])))

    def crop_pyramid(
        self,
        indices: NDArray[np.int32],
        settings: PyramidSettings,
        stages: Stages | None = None,
    ) -> Pyramid:
        """The pyramid of some of the tile's points.

        Args:
            indices: The points, ascending, shape (n,), int32.
            settings: Neighborhood and pyramid settings.
            stages: Told of the time that neighbors and decimation take.
        """
        return _pyramid(self.xyz[indices], self.keys[indices], settings, stages)


def cut_tile(
    scan: VoxelScan,
    tiling: Tiling,
    tile: Tile,
    settings: PyramidSettings,
    stages: Stages | None = None,
) -> TileData:
    """Cut a tile with its halo and find its normals and pyramid.

    The origin is subtracted in float64, before the cast to float32, and both lie on a lattice of
    `_STEPS` to a voxel. Labels are kept in the core only: each voxel teaches and is judged once,
    and a tile of the training area that borders on a held-out one never sees its labels.

    Args:
        scan: The scan's voxels.
        tiling: How it is cut.
        tile: Which tile.
        settings: Neighborhood and pyramid settings.
        stages: Told of the time that tiling, neighbors, decimation and normals take.

    Returns:
        The tile.
    """
    voxels, stages = scan.voxels, stages or Stages()
    with stages.timed("tiling"):
        indices, is_core = tiling.members(tile)
        xyz, origin = _local_positions(voxels.xyz, indices, voxels.grid.voxel_size)
        keys = voxels.keys[indices]
        labels = np.full(len(indices), -1, dtype=np.int16)
        if voxels.labels is not None:
            labels[is_core] = voxels.labels[indices[is_core]]
        features = {name: columns[indices] for name, columns in scan.features.items()}
        counts = voxels.counts[indices].astype(np.int32)
    pyramid = _pyramid(xyz, keys, settings, stages)
    with stages.timed("normals"):
        sensor = None if scan.sensor is None else scan.sensor - origin
        normals = estimate_normals(xyz, pyramid.neighbors[0], sensor)
    return TileData(
        origin=origin + voxels.grid.origin,
        indices=indices,
        is_core=is_core,
        keys=keys,
        xyz=xyz,
        normals=normals,
        features=features,
        labels=labels,
        counts=counts,
        pyramid=pyramid,
    )


def _local_positions(
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
    step = 2.0 ** np.floor(np.log2(voxel_size / _STEPS))
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
def _reaches(xyz: NDArray[np.float32], neighbors: NDArray[np.int32]) -> NDArray[np.float32]:
    """Distance of each point to the last of its neighbors, shape (N,), float32."""
    reaches = np.empty(len(xyz), np.float32)
    for i in range(len(xyz)):
        last = neighbors[i, -1]
        x, y, z = xyz[last, 0] - xyz[i, 0], xyz[last, 1] - xyz[i, 1], xyz[last, 2] - xyz[i, 2]
        reaches[i] = np.sqrt(x * x + y * y + z * z)
    return reaches


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


def _pyramid(
    xyz: NDArray[np.float32],
    keys: NDArray[np.int64],
    settings: PyramidSettings,
    stages: Stages | None = None,
) -> Pyramid:
    """:func:`build_pyramid` with its settings taken from where they stand."""
    return build_pyramid(
        xyz,
        keys,
        num_neighbors=settings.num_neighbors,
        num_levels=settings.num_levels,
        decimation=settings.decimation,
        sampling=settings.sampling,
        seed=settings.seed,
        stages=stages,
    )
