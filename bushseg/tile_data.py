"""A tile, cut out of a scan and ready for the network: local coordinates, normals, pyramid."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from bushseg.config import Sampling
from bushseg.local_positions import local_positions
from bushseg.neighbors import reaches
from bushseg.normals import estimate_normals
from bushseg.pyramid import Pyramid, build_pyramid
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.tiling import Tile, Tiling


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

    def __len__(self) -> int:
        return len(self.xyz)

    def crop_pyramid(self, indices: NDArray[np.int32], settings: PyramidSettings) -> Pyramid:
        """The pyramid of some of the tile's points.

        Args:
            indices: The points, ascending, shape (n,), int32.
            settings: Neighborhood and pyramid settings.
        """
        return _pyramid(self.xyz[indices], self.keys[indices], settings)


@dataclass(frozen=True, slots=True)
class CropSource:
    """What crops are drawn from: of a tile's voxels what decides which, and their pyramids.

    Attributes:
        is_core: Whether a voxel belongs to the core, (N,) bool.
        keys: Voxel keys, (N,) int64.
        xyz: Metres from the tile's origin, (N, 3) float32.
        labels: Class index; -1 for unlabelled and for all of the halo, (N,) int16.
    """

    is_core: NDArray[np.bool_]
    keys: NDArray[np.int64]
    xyz: NDArray[np.float32]
    labels: NDArray[np.int16]

    def take(self, indices: NDArray[np.int32]) -> Self:
        """Some of them, shape (n,), int32."""
        return type(self)(*(getattr(self, name)[indices] for name in CropSource.__slots__))

    def pyramid(self, settings: PyramidSettings) -> Pyramid:
        """The pyramid of all of them."""
        return _pyramid(self.xyz, self.keys, settings)


@dataclass(frozen=True, slots=True)
class NetworkTile(TileData):
    """A tile with all that the network needs of it.

    Attributes:
        pyramid: Indices of all levels.
    """

    pyramid: Pyramid

    @classmethod
    def of(cls, tile: TileData, settings: PyramidSettings) -> Self:
        """Find a tile's pyramid."""
        pyramid = _pyramid(tile.xyz, tile.keys, settings)
        return cls(**{name: getattr(tile, name) for name in TileData.__slots__}, pyramid=pyramid)

    def neighbor_distance(self) -> float:
        """Median distance to the farthest of the K neighbors, metres: the tile's density."""
        return float(np.median(reaches(self.xyz, self.pyramid.neighbors[0])))


def cut_points(
    scan: VoxelScan, tiling: Tiling, tile: Tile, normals: NDArray[np.float32]
) -> TileData:
    """Cut a tile with its halo out of a scan whose normals are known.

    The origin is subtracted in float64, before the cast to float32. Labels are kept in the core
    only: each voxel teaches and is judged once, and a tile of the training area that borders on a
    held-out one never sees its labels.

    Args:
        scan: The scan's voxels.
        tiling: How it is cut.
        tile: Which tile.
        normals: Normals of all voxels, shape (N, 3), float32.

    Returns:
        The tile.
    """
    indices, is_core = tiling.members(tile)
    xyz, origin = local_positions(scan.voxels.xyz, indices, scan.voxels.grid.voxel_size)
    tile_data = TileData(
        **_columns(scan, indices, is_core, origin), xyz=xyz, normals=normals[indices]
    )
    scan.voxels.scratch.release()
    return tile_data


def cut_tile(
    scan: VoxelScan,
    tiling: Tiling,
    tile: Tile,
    settings: PyramidSettings,
    stages: Stages | None = None,
) -> NetworkTile:
    """Cut a tile with its halo as :func:`cut_points` does, and find its normals and pyramid.

    Args:
        scan: The scan's voxels.
        tiling: How it is cut.
        tile: Which tile.
        settings: Neighborhood and pyramid settings.
        stages: Told of the time that tiling, neighbors, decimation and normals take.

    Returns:
        The tile.
    """
    stages = stages or Stages()
    with stages.timed("tiling"):
        indices, is_core = tiling.members(tile)
        xyz, origin = local_positions(scan.voxels.xyz, indices, scan.voxels.grid.voxel_size)
        columns = _columns(scan, indices, is_core, origin)
        scan.voxels.scratch.release()
    pyramid = _pyramid(xyz, columns["keys"], settings, stages)
    with stages.timed("normals"):
        sensor = None if scan.sensor is None else scan.sensor - origin
        normals = estimate_normals(xyz, pyramid.neighbors[0], sensor)
    return NetworkTile(**columns, xyz=xyz, normals=normals, pyramid=pyramid)


def _columns(
    scan: VoxelScan,
    indices: NDArray[np.int64],
    is_core: NDArray[np.bool_],
    origin: NDArray[np.float64],
) -> dict[str, Any]:
    """What a tile has of its scan, by the names of TileData's attributes."""
    voxels = scan.voxels
    labels = np.full(len(indices), -1, dtype=np.int16)
    if voxels.labels is not None:
        labels[is_core] = voxels.labels[indices[is_core]]
    return {
        "origin": origin + voxels.grid.origin,
        "indices": indices,
        "is_core": is_core,
        "keys": voxels.keys[indices],
        "features": {name: columns[indices] for name, columns in scan.features.items()},
        "labels": labels,
        "counts": voxels.counts[indices].astype(np.int32),
    }


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
