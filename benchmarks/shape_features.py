"""What a classical classifier is told of a voxel: eigenvalues at several scales, density, height.

The features of Weinmann et al., "Semantic point cloud interpretation based on optimal
neighborhoods, relevant features and efficient classifiers", 2015, at scales spread as in Thomas
et al., "Semantic classification of 3D point clouds with multiscale spherical neighborhoods", 2018:
a neighborhood of radius r is searched among voxels of a fraction of r, so that a wide one costs no
more than a narrow one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.features import normalize
from bushseg.grid import VoxelGrid
from bushseg.neighbors import NeighborIndex
from bushseg.scan import VoxelScan
from bushseg.subsample import GridSubsampler

SCALES = (1.0, 3.0, 8.0)
"""Voxels that a neighborhood is searched among, as multiples of the scan's voxel size."""

REACH = 2.5
"""Radius of a neighborhood, in voxels of its scale: 0.25, 0.75 and 2 m at voxels of 0.1 m."""

NUM_NEIGHBORS = 24
_CHUNK = 50_000
_PER_SCALE = (
    "linearity",
    "planarity",
    "scattering",
    "variation",
    "verticality",
    "spread",
    "number",
)


@dataclass(frozen=True)
class Shape:
    """Eigenvalue features of neighborhoods.

    Attributes:
        linearity: (l1 - l2) / l1 of the covariance's eigenvalues l1 >= l2 >= l3, (N,) float32.
        planarity: (l2 - l3) / l1, (N,) float32.
        scattering: l3 / l1, (N,) float32.
        variation: l3 / (l1 + l2 + l3), "change of curvature", (N,) float32.
        verticality: 1 - |n_z| of the normal, (N,) float32.
        spread: Height from the lowest to the highest neighbor, metres, (N,) float32.
        number: Neighbors within the radius, at most K, (N,) float32.
    """

    linearity: NDArray[np.float32]
    planarity: NDArray[np.float32]
    scattering: NDArray[np.float32]
    variation: NDArray[np.float32]
    verticality: NDArray[np.float32]
    spread: NDArray[np.float32]
    number: NDArray[np.float32]


def feature_names() -> list[str]:
    """What the columns of :func:`voxel_features` are, those of intensity aside."""
    return ["height", *(f"{name} x{scale:g}" for scale in SCALES for name in _PER_SCALE)]


def voxel_features(
    scan: VoxelScan, *, intensity: bool, chosen: NDArray[np.intp] | None = None
) -> NDArray[np.float32]:
    """Features of a scan's voxels.

    Args:
        scan: The scan.
        intensity: Whether to add the intensity as the network gets it, zeros where there is none.
        chosen: Indices of the voxels whose features are wanted, (M,); None: all.

    Returns:
        Shape (M, F), float32.
    """
    size = scan.voxels.grid.voxel_size
    xyz = _local(scan.voxels.xyz)
    rows = np.arange(len(xyz)) if chosen is None else chosen
    columns = [scan.features["height"][rows, 0]]
    for scale in SCALES:
        sites = xyz if scale == 1 else coarse(scan.voxels.xyz, scale * size)
        shape = shapes(xyz[rows], sites, REACH * scale * size)
        columns += [getattr(shape, name) for name in _PER_SCALE]
    if intensity:
        own = scan.features.get("intensity")
        columns.append(np.zeros(len(rows), np.float32) if own is None else own[rows, 0])
    return np.stack(columns, axis=1)


def coarse(xyz: NDArray[np.float64], voxel_size: float) -> NDArray[np.float32]:
    """Positions sub-sampled by a coarser grid, in the frame of :func:`_local`, (M, 3) float32."""
    subsampler = GridSubsampler(VoxelGrid.around(xyz[0], voxel_size))
    subsampler.add(xyz, {})
    voxels = subsampler.finish()
    return (voxels.xyz + (voxels.grid.origin - xyz.mean(axis=0))).astype(np.float32)


def _local(xyz: NDArray[np.float64]) -> NDArray[np.float32]:
    """Positions from their mean, (N, 3) float32."""
    return (xyz - xyz.mean(axis=0)).astype(np.float32)


def metres_above_ground(scan: VoxelScan) -> NDArray[np.float32]:
    """Height of a scan's voxels above the local ground, metres, (N,) float32."""
    unit = normalize({}, np.ones(1, np.float32))["height"][0, 0]
    return scan.features["height"][:, 0] / unit


def shapes(queries: NDArray[np.float32], sites: NDArray[np.float32], radius: float) -> Shape:
    """Features of the neighborhood of each query.

    Args:
        queries: Places, metres, (N, 3) float32.
        sites: Where neighbors are searched, (M, 3) float32.
        radius: Neighbors farther than this don't count, metres; the nearest always does.
    """
    index = NeighborIndex(sites)
    parts = [
        _shapes(queries[start : start + _CHUNK], sites, index, radius)
        for start in range(0, len(queries), _CHUNK)
    ]
    return Shape(*np.concatenate(parts, axis=1))


def _shapes(
    queries: NDArray[np.float32], sites: NDArray[np.float32], index: NeighborIndex, radius: float
) -> NDArray[np.float32]:
    """One chunk of queries: the seven features as rows, (7, N) float32."""
    offsets = sites[index.query(queries, min(NUM_NEIGHBORS, len(sites)))] - queries[:, None]
    inside = np.linalg.norm(offsets, axis=2) <= radius
    inside[:, 0] = True
    weights = inside[..., None].astype(np.float32)
    number = weights.sum(axis=1)
    centered = (
        offsets - (offsets * weights).sum(axis=1, keepdims=True) / number[:, None]
    ) * weights
    covariance = np.einsum("nki,nkj->nij", centered, centered) / number[:, None]
    values, vectors = np.linalg.eigh(covariance)
    low, middle, high = np.maximum(values, 0).T
    top = np.maximum(high, 1e-12)  # a single neighbor has no extent: all shapes are 0
    z = offsets[..., 2]
    spread = np.where(inside, z, -np.inf).max(axis=1) - np.where(inside, z, np.inf).min(axis=1)
    return np.stack(
        [
            (high - middle) / top,
            (middle - low) / top,
            low / top,
            low / np.maximum(low + middle + high, 1e-12),
            1 - np.abs(vectors[:, 2, 0]),
            spread,
            number[:, 0],
        ]
    ).astype(np.float32)
