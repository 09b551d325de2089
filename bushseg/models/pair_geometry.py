"""The geometry of a neighborhood's pairs, compiled.

Arrays are as :mod:`bushseg.models.kernels` has them. The same in plain PyTorch stands in `lmff.py`
and `spf.py`; the tests hold this to it.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from bushseg.compiled import compiled_fast
from bushseg.models.kernels import Floats, Indices

_ONE, _ZERO = np.float32(1), np.float32(0)
_TINY: Any = np.float32(np.finfo(np.float32).tiny)

# Abramowitz and Stegun, Handbook of Mathematical Functions, 4.4.49: atan on [0, 1] to 2e-8.
_ATAN = tuple(
    np.float32(value)
    for value in (
        -0.0040540580,
        0.0218612288,
        -0.0559098861,
        0.0964200441,
        -0.1390853351,
        0.1994653599,
        -0.3332985605,
        0.9999993329,
    )
)


@compiled_fast
def _atan2(y: Any, x: Any) -> Any:
    """The angle of (x, y), to float32's precision and without a library call a pair."""
    across, along = abs(y), abs(x)
    t = min(across, along) / max(across, along, _TINY)
    s = t * t
    p = _ATAN[0]
    p = p * s + _ATAN[1]
    p = p * s + _ATAN[2]
    p = p * s + _ATAN[3]
    p = p * s + _ATAN[4]
    p = p * s + _ATAN[5]
    p = p * s + _ATAN[6]
    p = p * s + _ATAN[7]
    angle = p * t
    angle = np.float32(math.pi / 2) - angle if across > along else angle
    angle = np.float32(math.pi) - angle if x < 0 else angle
    return -angle if y < 0 else angle


@lru_cache
def describe_kernel(num_neighbors: int, num_position: int, spf: bool) -> Callable[..., None]:
    """Compile the geometry of pairs for K neighbors and the columns wanted.

    Args:
        num_neighbors: K.
        num_position: 0, 4 (offset, distance) or 10 (p_i and p_k before them).
        spf: Whether alpha, phi and theta (eq. 4-9) follow.

    Returns:
        A compiled function; its arguments are said below.
    """
    k_count, offset = num_neighbors, max(0, num_position - 4)
    angles = num_position  # where alpha stands
    num_columns = num_position + 3 * spf + 1

    @compiled_fast
    def describe(
        xyz: Floats, normals: Floats, neighbors: Indices, start: int, stop: int, out: Floats
    ) -> None:
        """Position encoding and SPF of each pair, and a column of ones.

        Args:
            xyz: Positions, (N, 3).
            normals: Unit normals, (N, 3).
            neighbors: Neighbor indices, (N, K).
            start: First point.
            stop: Point after the last.
            out: Written to, (stop - start, K, columns).
        """
        # One point's columns as rows, so that its neighbors are worked on abreast.
        rows = np.ones((num_columns, k_count), np.float32)
        p, q = np.empty((3, k_count), np.float32), np.empty((3, k_count), np.float32)
        for n in range(start, stop):
            x, y, z = xyz[n, 0], xyz[n, 1], xyz[n, 2]
            ux, uy, uz = normals[n, 0], normals[n, 1], normals[n, 2]
            for k in range(k_count):
                j = neighbors[n, k]
                p[0, k], p[1, k], p[2, k] = xyz[j, 0], xyz[j, 1], xyz[j, 2]
                q[0, k], q[1, k], q[2, k] = normals[j, 0], normals[j, 1], normals[j, 2]
            for k in range(k_count):
                dx, dy, dz = p[0, k] - x, p[1, k] - y, p[2, k] - z
                distance = np.float32(math.sqrt(dx * dx + dy * dy + dz * dz))
                if num_position == 10:
                    rows[0, k], rows[1, k], rows[2, k] = x, y, z
                    rows[3, k], rows[4, k], rows[5, k] = p[0, k], p[1, k], p[2, k]
                if num_position:
                    rows[offset, k], rows[offset + 1, k], rows[offset + 2, k] = -dx, -dy, -dz
                    rows[offset + 3, k] = distance
                if spf:
                    nx, ny, nz = q[0, k], q[1, k], q[2, k]
                    inverse = _ONE / max(distance, _TINY)
                    ex, ey, ez = dx * inverse, dy * inverse, dz * inverse
                    vx, vy, vz = uy * ez - uz * ey, uz * ex - ux * ez, ux * ey - uy * ex
                    wx, wy, wz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
                    theta = _atan2(wx * nx + wy * ny + wz * nz, ux * nx + uy * ny + uz * nz)
                    rows[angles, k] = vx * nx + vy * ny + vz * nz
                    rows[angles + 1, k] = ux * ex + uy * ey + uz * ez
                    rows[angles + 2, k] = theta if distance > 0 else _ZERO
            for k in range(k_count):
                for g in range(num_columns):
                    out[n - start, k, g] = rows[g, k]

    return describe
