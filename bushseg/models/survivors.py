"""Max-pooling onto the points that survive a decimation."""

from typing import Any

import torch
from torch import Tensor

from bushseg.models import kernels
from bushseg.models.batch import Level
from bushseg.models.chunks import run_chunks
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
            kernels.max_rows(rows, indices, start, stop, out)

        run_chunks(call, len(around), 2048)
        ctx.save_for_backward(x, around, pooled)
        return pooled

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        x, around, pooled = ctx.saved_tensors
        d_pooled = gradients[0].contiguous()
        d_x = torch.zeros_like(x)
        arrays = (tensor.detach().numpy() for tensor in (x, around, pooled, d_pooled, d_x))
        kernels.max_rows_backward(*arrays)
        return d_x, None
