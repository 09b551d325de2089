"""The loops of attentive pooling, compiled: what PyTorch would do in many passes over memory.

All arrays are float32 and C-contiguous, indices int32. `start` and `stop` name the points worked
on; arrays over pairs hold theirs alone, point by point, K rows each. The same in plain PyTorch
stands in `lmff.py` and `attention.py`; the tests hold these to it.
"""

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

_ZERO, _SLOPE = np.float32(0), np.float32(SLOPE)


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
