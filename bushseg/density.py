"""How dense a scan is, as a model would see it, from a sample of its points.

The measure is the one that stands in a model's card: the distance from a voxel to the last of its K
nearest. A tripod fills the voxels around it and leaves gaps far out; a survey from the air is thin
and even. So not only the median is told but how far it spreads.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.grid import VoxelGrid
from bushseg.io.base import ScanReader
from bushseg.io.kept import KeptReader
from bushseg.neighbors import NeighborIndex
from bushseg.scan import mask_no_returns
from bushseg.subsample import GridSubsampler

HEAD_POINTS = 2_000_000
"""Points that are read to judge a scan; they are kept, and so read once."""

_QUERIES = 20_000
_RASTER = 64
_PATCH = 10.0  # metres
_PATCHES = 32


@dataclass(frozen=True, slots=True)
class Density:
    """Distances to the K-th neighbor among a scan's voxels, metres.

    Attributes:
        near: The 10 % quantile: where the scan is dense.
        median: The 50 % quantile, which cards hold.
        far: The 90 % quantile: where it is sparse.
    """

    near: float
    median: float
    far: float

    @property
    def spread(self) -> float:
        """Far over near: about 2 for an even survey, more where a sensor stood in the scene."""
        return self.far / self.near if self.near > 0 else float("inf")


def sample_points(kept: KeptReader) -> NDArray[np.float64]:
    """Points that show a scan's density, coordinates as read, shape (M, 3), float64; all finite.

    The first ones are taken: in most files they lie side by side, as the sensor saw them. In a file
    that gives an overview first, as COPC does, they are too thin, and it is read to its end for the
    points of a few patches.

    Args:
        kept: The scan; what is read stays with it.
    """
    chunks = kept.head(HEAD_POINTS)
    share = sum(map(len, chunks)) / max(kept.info.num_points, 1)
    head = np.concatenate([np.empty((0, 3)), *(_finite(chunk.xyz, kept) for chunk in chunks)])
    if not _is_overview(head, kept.info.bounds, share):
        return head
    chosen = np.unique(_patch(np.random.default_rng(0).permutation(head)[:_PATCHES]))
    everything = (_finite(chunk.xyz, kept) for chunk in kept.chunks())
    return np.concatenate([xyz[np.isin(_patch(xyz), chosen)] for xyz in everything])


def measure_density(xyz: NDArray[np.float64], voxel_size: float, num_neighbors: int) -> Density:
    """Distances to the K-th neighbor among the voxels of some points.

    Args:
        xyz: Coordinates, finite, shape (N, 3), float64; N >= 1.
        voxel_size: Edge of a voxel, metres.
        num_neighbors: K, the voxel itself among them.
    """
    subsampler = GridSubsampler(VoxelGrid.around(xyz[0], voxel_size))
    subsampler.add(xyz, {})
    voxels = subsampler.finish().xyz
    points = (voxels - voxels.mean(axis=0)).astype(np.float32)
    queries = np.arange(0, len(points), max(1, len(points) // _QUERIES))
    last = NeighborIndex(points).query(points[queries], num_neighbors)[:, -1]
    distances = np.linalg.norm(points[last] - points[queries], axis=1)
    near, median, far = np.quantile(distances, (0.1, 0.5, 0.9)).tolist()
    return Density(near, median, far)


def _finite(xyz: NDArray[np.float64], reader: ScanReader) -> NDArray[np.float64]:
    """The points that a voxel could take."""
    xyz = mask_no_returns(xyz, reader)
    return xyz[np.isfinite(xyz).all(axis=1)]


def _is_overview(
    head: NDArray[np.float64], bounds: NDArray[np.float64] | None, share: float
) -> bool:
    """Whether a small share of a scan's points is spread over most of its area."""
    if share >= 1 or bounds is None or not len(head):
        return False
    low, high = bounds[:, :2]
    cells = ((head[:, :2] - low) / np.maximum(high - low, 1e-9) * _RASTER).astype(np.int64)
    cells = np.unique(cells.clip(0, _RASTER - 1) @ np.array([_RASTER, 1]))
    covered = len(cells) / _RASTER**2
    return covered > 0.5 and covered > 4 * share


def _patch(xyz: NDArray[np.float64]) -> NDArray[np.int64]:
    """The patch of ground that each point stands on, one number each, shape (N,), int64."""
    cells = np.floor(xyz[:, :2] / _PATCH).astype(np.int64)
    numbers: NDArray[np.int64] = cells[:, 0] << 32 ^ cells[:, 1]
    return numbers
