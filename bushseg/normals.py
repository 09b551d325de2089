"""Normals by principal components of each neighborhood (section 3.3, step 1), with a stated sign.

The eigenvector of the covariance's smallest eigenvalue has no sign, and SPF depends on one. Where
the sensor's position is known, normals point to it; elsewhere they point up. A vertical surface
without a known sensor keeps a sign that only noise decides: SPF's alpha and theta are then
uncertain in sign there.

The neighborhoods are those the network uses, so no second search is made.
"""

import numpy as np
from numpy.typing import NDArray

UP = np.array([0.0, 0.0, 1.0], dtype=np.float32)

_CHUNK = 16_384  # neighborhoods whose intermediate arrays stay in cache


def estimate_normals(
    xyz: NDArray[np.float32],
    neighbors: NDArray[np.int32],
    sensor: NDArray[np.floating] | None = None,
) -> NDArray[np.float32]:
    """Unit normals of a set of points.

    Args:
        xyz: Positions relative to a nearby origin, shape (N, 3), float32.
        neighbors: Neighbor indices, each row's own point included, shape (N, K), int32.
        sensor: Where the sensor stood, in the same frame, shape (3,); None orients upwards.

    Returns:
        Unit normals, shape (N, 3), float32. A neighborhood on a line gets some normal across the
        line, one without extent (a lone point, duplicates) the upward normal.
    """
    normals = np.empty_like(xyz)
    for start in range(0, len(xyz), _CHUNK):
        rows = slice(start, start + _CHUNK)
        # Relative to the point itself: products of large coordinates would drown the differences.
        offsets = (xyz[neighbors[rows]] - xyz[rows, None]).astype(np.float64)
        normals[rows] = smallest_eigenvectors(covariances(offsets))
    return orient(xyz, normals, sensor)


def covariances(offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of each neighborhood as (xx, yy, zz, xy, xz, yz): (N, K, 3) -> (6, N)."""
    x, y, z = (np.ascontiguousarray(offsets[..., axis]) for axis in range(3))
    for column in (x, y, z):
        column -= column.mean(axis=1, keepdims=True)
    pairs = ((x, x), (y, y), (z, z), (x, y), (x, z), (y, z))
    return np.stack([np.einsum("nk,nk->n", a, b) for a, b in pairs]) / offsets.shape[1]


def smallest_eigenvectors(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit eigenvector of the smallest eigenvalue of symmetric 3 x 3 matrices.

    The eigenvalue in closed form (Smith, "Eigenvalues of a symmetric 3 x 3 matrix", 1961); the
    eigenvector is perpendicular to the rows of A - lambda I, so it is the longest of their cross
    products. Several times as fast as LAPACK, matrix by matrix.

    Args:
        covariance: (xx, yy, zz, xy, xz, yz), shape (6, N), float64.

    Returns:
        Shape (N, 3), float64, either sign; `UP` where the matrix has no extent in any direction.
    """
    # Scaled to unit trace, so that thresholds mean the same for every neighborhood.
    trace = covariance[:3].sum(axis=0)
    flat = ~(trace > 0)
    xx, yy, zz, xy, xz, yz = covariance / np.where(flat, 1, trace)
    mean = (xx + yy + zz) / 3
    spread = (xx - mean) ** 2 + (yy - mean) ** 2 + (zz - mean) ** 2
    p = np.sqrt((spread + 2 * (xy**2 + xz**2 + yz**2)) / 6)
    a, b, c = xx - mean, yy - mean, zz - mean
    determinant = a * (b * c - yz**2) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    cosine = determinant / np.maximum(2 * p**3, 1e-300)
    angle = np.arccos(np.clip(cosine, -1, 1)) / 3
    smallest = mean + 2 * p * np.cos(angle + 2 * np.pi / 3)
    rows = np.stack(
        [
            np.stack([xx - smallest, xy, xz], axis=1),
            np.stack([xy, yy - smallest, yz], axis=1),
            np.stack([xz, yz, zz - smallest], axis=1),
        ]
    )
    crosses = np.stack([np.cross(rows[i], rows[j]) for i, j in ((0, 1), (0, 2), (1, 2))])
    lengths = np.linalg.norm(crosses, axis=2)
    best = lengths.argmax(axis=0)
    each = np.arange(len(best))
    vector, length = crosses[best, each], lengths[best, each]
    # On a line two eigenvalues vanish and so do the cross products: any vector across the line.
    line = length < 1e-12
    if line.any():
        vector[line] = _across(rows[:, line])
        length[line] = np.linalg.norm(vector[line], axis=1)
    vector[flat], length[flat] = UP, 1
    return vector / np.maximum(length, 1e-300)[:, None]


def orient(
    xyz: NDArray[np.float32],
    normals: NDArray[np.float32],
    sensor: NDArray[np.floating] | None,
) -> NDArray[np.float32]:
    """Flip normals to the sensor, or upwards where there is none; shapes as above."""
    towards = normals[:, 2] if sensor is None else np.einsum("ij,ij->i", normals, sensor - xyz)
    return np.where((towards < 0)[:, None], -normals, normals)


def _across(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """A vector across the line that rank-one matrices span: (3, N, 3) -> (N, 3), any length."""
    lengths = np.linalg.norm(rows, axis=2)
    along = rows[lengths.argmax(axis=0), np.arange(rows.shape[1])]
    # The up direction where the line allows it, else x.
    steep = np.abs(along[:, 2]) > 0.9 * np.linalg.norm(along, axis=1)
    helper = np.where(steep[:, None], np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))
    side = np.cross(along, helper)
    across: NDArray[np.float64] = np.where(
        lengths.max(axis=0)[:, None] > 0, np.cross(side, along), UP
    )
    return across
