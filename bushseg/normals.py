"""Normals by principal components of each neighborhood (section 3.3, step 1), with a stated sign.

The eigenvector of the covariance's smallest eigenvalue has no sign, and SPF depends on one. Where
the sensor's position is known, normals point to it; elsewhere they point up. A vertical surface
without a known sensor keeps a sign that only noise decides: SPF's alpha and theta are then
uncertain in sign there.

The neighborhoods are those the network uses, so no second search is made.
"""

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.parallel import for_chunks

UP = np.array([0.0, 0.0, 1.0], dtype=np.float32)

_CHUNK = 8192  # neighborhoods a thread takes at a time
_LINE = 1e-12  # a cross product this short, of unit trace, has no direction


def estimate_normals(
    xyz: NDArray[np.float32],
    neighbors: NDArray[np.int32],
    sensor: NDArray[np.floating] | None = None,
) -> NDArray[np.float32]:
    """Unit normals of a set of points, or of some of them.

    Args:
        xyz: Positions relative to a nearby origin, shape (N, 3), float32.
        neighbors: For each point whose normal is wanted its neighbors' indices, itself (or a point
            in its place) first, shape (M, K), int32.
        sensor: Where the sensor stood, in the same frame, shape (3,); None orients upwards.

    Returns:
        Unit normals, shape (M, 3), float32. A neighborhood on a line gets some normal across the
        line, one without extent (a lone point, duplicates) the upward normal.
    """
    normals = np.empty((len(neighbors), 3), dtype=np.float32)
    # Upwards is towards a sensor at infinity: the direction is then the same from everywhere.
    towards = np.array([0.0, 0.0, 1.0]) if sensor is None else np.asarray(sensor, dtype=np.float64)

    def estimate(start: int, stop: int) -> None:
        _estimate(xyz, neighbors, towards, sensor is not None, normals, start, stop)

    for_chunks(estimate, len(neighbors), _CHUNK)
    return normals


@compiled
def _estimate(
    xyz: NDArray[np.float32],
    neighbors: NDArray[np.int32],
    towards: NDArray[np.float64],
    is_place: bool,
    normals: NDArray[np.float32],
    start: int,
    stop: int,
) -> None:
    """Normals of neighborhoods start to stop, oriented to a place or in a direction."""
    k = neighbors.shape[1]
    x, y, z = np.empty(k), np.empty(k), np.empty(k)
    for i in range(start, stop):
        # Relative to the point itself: products of large coordinates would drown the differences.
        own = np.uint32(neighbors[i, 0])
        for j in range(k):
            other = np.uint32(neighbors[i, j])
            x[j] = np.float64(xyz[other, 0] - xyz[own, 0])
            y[j] = np.float64(xyz[other, 1] - xyz[own, 1])
            z[j] = np.float64(xyz[other, 2] - xyz[own, 2])
        a, b, c = smallest_eigenvector(*covariance(x, y, z))
        if is_place:
            up = a * (towards[0] - xyz[own, 0]) + b * (towards[1] - xyz[own, 1])
            up += c * (towards[2] - xyz[own, 2])
        else:
            up = a * towards[0] + b * towards[1] + c * towards[2]
        sign = -1.0 if up < 0 else 1.0
        normals[i, 0], normals[i, 1], normals[i, 2] = sign * a, sign * b, sign * c


@compiled
def covariance(
    x: NDArray[np.float64], y: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[float, float, float, float, float, float]:
    """Covariance of K positions, each (K,): xx, yy, zz, xy, xz, yz. The positions are centered."""
    k = len(x)
    mean_x = mean_y = mean_z = 0.0
    for j in range(k):
        mean_x, mean_y, mean_z = mean_x + x[j], mean_y + y[j], mean_z + z[j]
    mean_x, mean_y, mean_z = mean_x / k, mean_y / k, mean_z / k
    xx = yy = zz = xy = xz = yz = 0.0
    for j in range(k):
        dx, dy, dz = x[j] - mean_x, y[j] - mean_y, z[j] - mean_z
        xx, yy, zz = xx + dx * dx, yy + dy * dy, zz + dz * dz
        xy, xz, yz = xy + dx * dy, xz + dx * dz, yz + dy * dz
    return xx / k, yy / k, zz / k, xy / k, xz / k, yz / k


@compiled
def smallest_eigenvector(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float]:
    """Unit eigenvector of the smallest eigenvalue of a symmetric 3 x 3 matrix, either sign.

    The eigenvalue in closed form (Smith, "Eigenvalues of a symmetric 3 x 3 matrix", 1961); the
    eigenvector is perpendicular to the rows of A - lambda I, so it is the longest of their cross
    products. `UP` where the matrix has no extent in any direction.
    """
    trace = xx + yy + zz
    if not trace > 0:
        return 0.0, 0.0, 1.0
    # Scaled to unit trace, so that thresholds mean the same for every neighborhood.
    xx, yy, zz, xy, xz, yz = xx / trace, yy / trace, zz / trace, xy / trace, xz / trace, yz / trace
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    p = np.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    cosine = min(max(determinant / max(2 * p * p * p, 1e-300), -1.0), 1.0)
    smallest = mean + 2 * p * np.cos(np.arccos(cosine) / 3 + 2 * np.pi / 3)
    a, b, c = xx - smallest, yy - smallest, zz - smallest  # the rows are a xy xz, xy b yz, xz yz c
    best = _cross(a, xy, xz, xy, b, yz)
    for other in (_cross(a, xy, xz, xz, yz, c), _cross(xy, b, yz, xz, yz, c)):
        if other[3] > best[3]:
            best = other
    if best[3] < _LINE * _LINE:
        best = _across(a, b, c, xy, xz, yz)
    length = np.sqrt(best[3])
    return best[0] / length, best[1] / length, best[2] / length


@compiled
def _cross(
    x0: float, y0: float, z0: float, x1: float, y1: float, z1: float
) -> tuple[float, float, float, float]:
    """A cross product and its squared length."""
    x, y, z = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
    return x, y, z, x * x + y * y + z * z


@compiled
def _across(
    a: float, b: float, c: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float, float]:
    """A vector across the line that a rank-one matrix spans, and its squared length.

    On a line two eigenvalues vanish and so do the cross products: any vector across will do. It is
    the one closest to upwards where the line allows it, else to x.
    """
    x, y, z = a, xy, xz
    if b > max(a, c):  # the longest row is that of the largest diagonal
        x, y, z = xy, b, yz
    elif c > max(a, b):
        x, y, z = xz, yz, c
    if z * z > 0.81 * (x * x + y * y + z * z):
        side = _cross(x, y, z, 1.0, 0.0, 0.0)
    else:
        side = _cross(x, y, z, 0.0, 0.0, 1.0)
    across = _cross(side[0], side[1], side[2], x, y, z)
    return across if across[3] > 0 else (0.0, 0.0, 1.0, 1.0)
