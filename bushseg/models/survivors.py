"""Max-pooling onto the points that survive a decimation."""

from typing import Any

import numpy as np
import torch
from torch import Tensor

from bushseg.compiled import compiled_fast
from bushseg.models.batch import Level
from bushseg.models.chunks import run_chunks
from bushseg.models.kernels import Floats, Indices
from bushseg.models.layers import gather


def pool_survivors(x: Tensor, level: Level) -> Tensor:
    """Max over each survivor's neighborhood: (N, C) -> (M, C)."""
    around = level.neighbors.index_select(0, level.decimated)  # (M, K)
    if x.device.type != "cpu" or x.dtype != torch.float32:
        return gather(x, around).amax(dim=1)
    pooled: Tensor = _MaxPool.apply(x, around)  # type: ignore[no-untyped-call]
    return pooled


class _MaxPool(torch.autograd.Function):
    """The max over rows of x, compiled; its gradient goes to the first neighbor that has it."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, around: Tensor) -> Tensor:
        pooled = torch.empty(len(around), x.shape[1])
        rows, indices, out = x.detach().numpy(), around.numpy(), pooled.numpy()

        def call(start: int, stop: int) -> None:
            _max_rows(rows, indices, start, stop, out)

        run_chunks(call, len(around), 2048)
        ctx.save_for_backward(x, around, pooled)
        return pooled

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        x, around, pooled = ctx.saved_tensors
        d_pooled = gradients[0].contiguous()
        d_x = torch.zeros_like(x)
        arrays = (tensor.detach().numpy() for tensor in (x, around, pooled, d_pooled, d_x))
        _max_rows_backward(*arrays)
        return d_x, None


@compiled_fast
def _max_rows(x: Floats, neighbors: Indices, start: int, stop: int, out: Floats) -> None:
    """Greatest of the neighbors' rows of x, channel by channel: (N, C) -> (M, C), M indexed."""
    for m in range(start, stop):
        out[m] = x[neighbors[m, 0]]
        for k in range(1, neighbors.shape[1]):
            j = neighbors[m, k]
            for c in range(x.shape[1]):
                out[m, c] = max(out[m, c], x[j, c])


@compiled_fast
def _max_rows_backward(
    x: Floats, neighbors: Indices, pooled: Floats, d_pooled: Floats, d_x: Floats
) -> None:
    """Gradients of `_max_rows` for all rows: to the first neighbor that holds the greatest value.

    Args:
        x: (N, C).
        neighbors: (M, K).
        pooled: What `_max_rows` gave, (M, C).
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
                share = left[c] if x[j, c] == pooled[m, c] else np.float32(0)
                d_x[j, c] += share
                left[c] -= share
