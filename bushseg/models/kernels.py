"""The loops over neighborhoods, compiled: what PyTorch would do in many passes over memory.

All arrays are float32 and C-contiguous, indices int32. `start` and `stop` name the points worked
on; arrays over pairs hold theirs alone, point by point, K rows each. The same in plain PyTorch
stands in `lmff.py`, `attention.py` and `spf.py`; the tests hold these to it.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled_fast

Floats = NDArray[np.float32]
Indices = NDArray[np.int32]

SLOPE = 0.2
"""Of the leaky ReLU, as in RandLA-Net's published code."""

_ONE, _ZERO, _SLOPE = np.float32(1), np.float32(0), np.float32(SLOPE)
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


@compiled_fast
def scatter_rows(rows: Floats, neighbors: Indices, start: int, stop: int, out: Floats) -> None:
    """Add pairs' rows, as far as `out` is wide, to their neighbors': what undoes gathering.

    Args:
        rows: (pairs, at least C).
        neighbors: Neighbor indices, (N, K).
        start: First point.
        stop: Point after the last.
        out: Added to, (N, C).
    """
    num_neighbors = neighbors.shape[1]
    for n in range(start, stop):
        for k in range(num_neighbors):
            j, m = neighbors[n, k], (n - start) * num_neighbors + k
            for c in range(out.shape[1]):
                out[j, c] += rows[m, c]


@compiled_fast
def leak_gradients(gradients: Floats, values: Floats, first: int) -> None:
    """Gradients of a leaky ReLU that gave `values`, in place, of the columns from `first` on.

    Args:
        gradients: (pairs, C).
        values: (pairs, C).
        first: First column.
    """
    offset = np.uintp(first)
    for m in range(len(values)):
        for c in range(values.shape[1] - first):
            column = offset + np.uintp(c)
            gradient = gradients[m, column]
            gradients[m, column] = gradient if values[m, column] > 0 else _SLOPE * gradient


@compiled_fast
def max_rows(x: Floats, neighbors: Indices, start: int, stop: int, out: Floats) -> None:
    """Greatest of the neighbors' rows of x, channel by channel: (N, C) -> (M, C), M indexed."""
    for m in range(start, stop):
        out[m] = x[neighbors[m, 0]]
        for k in range(1, neighbors.shape[1]):
            j = neighbors[m, k]
            for c in range(x.shape[1]):
                out[m, c] = max(out[m, c], x[j, c])


@compiled_fast
def max_rows_backward(
    x: Floats, neighbors: Indices, pooled: Floats, d_pooled: Floats, d_x: Floats
) -> None:
    """Gradients of `max_rows` for all rows: to the first neighbor that holds the greatest value.

    Args:
        x: (N, C).
        neighbors: (M, K).
        pooled: What `max_rows` gave, (M, C).
        d_pooled: (M, C).
        d_x: Added to, (N, C).
    """
    width = x.shape[1]
    left = np.empty(width, np.float32)
    for m in range(len(pooled)):
        for c in range(width):
            left[c] = d_pooled[m, c]
        for k in range(neighbors.shape[1]):
            j = neighbors[m, k]
            for c in range(width):
                share = left[c] if x[j, c] == pooled[m, c] else _ZERO
                d_x[j, c] += share
                left[c] -= share


class PairKernels(NamedTuple):
    """The loops that are compiled for one K and G, so that those over neighbors are unrolled.

    Attributes:
        fuse: Gathers and lifts the channels of each pair.
        pool: Pools them.
        pool_backward: Gradients of pooling.
    """

    fuse: Callable[..., None]
    pool: Callable[..., float]
    pool_backward: Callable[..., float]


@lru_cache
def pair_kernels(num_neighbors: int, num_columns: int) -> PairKernels:
    """Compile the loops over pairs for K neighbors and G columns of geometry."""
    k_count, g_count = num_neighbors, num_columns

    @compiled_fast
    def fuse(
        x: Floats,
        mapped: Floats,
        neighbors: Indices,
        columns: Floats,
        lift: Floats,
        start: int,
        stop: int,
        fused: Floats,
        scores: Floats,
    ) -> None:
        """The channels of each pair, and the share of its scores that its features have.

        Args:
            x: Features, (N, width).
            mapped: What they add to scores, (N, C).
            neighbors: Neighbor indices, (N, K).
            columns: Geometry, (N, K, G).
            lift: (G, L) with L = C - width.
            start: First point.
            stop: Point after the last.
            fused: Written to: x_k, then leaky_relu(columns lift), (pairs, C).
            scores: Written to: mapped_k, (pairs, C).
        """
        width = np.uintp(x.shape[1])  # unsigned: an index that can't be negative needs no check
        for n in range(start, stop):
            for k in range(k_count):
                j, m = neighbors[n, k], (n - start) * k_count + k
                for c in range(x.shape[1]):
                    fused[m, c] = x[j, c]
                for c in range(mapped.shape[1]):
                    scores[m, c] = mapped[j, c]
                for c in range(lift.shape[1]):
                    value = _ZERO
                    for g in range(g_count):
                        value += columns[n, k, g] * lift[g, c]
                    fused[m, width + np.uintp(c)] = value if value > 0 else _SLOPE * value

    @compiled_fast
    def pool(weights: Floats, fused: Floats, pooled: Floats, mean: Floats) -> Any:
        """Weighted and plain mean over each neighborhood.

        Args:
            weights: Exponentials of the scores, (pairs, C).
            fused: Values, (pairs, C).
            pooled: Written to: sum of weights times values, over the sum of weights, (points, C).
            mean: Written to, (points, C).

        Returns:
            A sum that is not finite if anything overflowed, or all weights of a point vanished.
        """
        check = _ZERO
        for n in range(len(pooled)):
            first = n * k_count
            for c in range(fused.shape[1]):
                weighted, total, plain = _ZERO, _ZERO, _ZERO
                for k in range(k_count):
                    weight, value = weights[first + k, c], fused[first + k, c]
                    weighted += weight * value
                    total += weight
                    plain += value
                pooled[n, c] = weighted / total
                mean[n, c] = plain / np.float32(k_count)
                check += weighted / total + total
        return check

    @compiled_fast
    def pool_backward(
        weights: Floats,
        fused: Floats,
        pooled: Floats,
        d_pooled: Floats,
        d_mean: Floats,
        d_fused: Floats,
    ) -> Any:
        """Gradients of `pool`; `weights` are replaced by the gradients of the scores.

        With a = softmax of the scores s: d value = a d pooled + d mean / K, and
        d s = a (value - pooled) d pooled. `d_fused` is written to, (pairs, C).
        """
        channels = fused.shape[1]
        up, flat = np.empty(channels, np.float32), np.empty(channels, np.float32)
        check = _ZERO
        for n in range(len(pooled)):
            first = n * k_count
            for c in range(channels):
                total = _ZERO
                for k in range(k_count):
                    total += weights[first + k, c]
                up[c], flat[c] = d_pooled[n, c] / total, d_mean[n, c] / np.float32(k_count)
                check += total  # without a sum over channels, they aren't taken abreast
            for k in range(k_count):
                for c in range(channels):
                    share = weights[first + k, c] * up[c]
                    weights[first + k, c] = share * (fused[first + k, c] - pooled[n, c])
                    d_fused[first + k, c] = share + flat[c]
        return check

    return PairKernels(fuse, pool, pool_backward)
