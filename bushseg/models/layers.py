"""Shared multi-layer perceptrons and gathering, over points laid end to end."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

NEGATIVE_SLOPE = 0.2
"""Of the leaky ReLU, as in RandLA-Net's published code."""


class SharedMLP(nn.Module):
    """A linear map, batch normalization and an activation, the same for every point.

    Args:
        num_in: Input width.
        num_out: Output width.
        activation: Whether a leaky ReLU follows.
    """

    def __init__(self, num_in: int, num_out: int, *, activation: bool = True) -> None:
        super().__init__()
        self.linear = nn.Linear(num_in, num_out, bias=False)
        self.norm = nn.BatchNorm1d(num_out)
        self.activation = activation

    def forward(self, x: Tensor) -> Tensor:
        """(..., num_in) -> (..., num_out)."""
        return self.finish(self.linear(x))

    def finish(self, mapped: Tensor) -> Tensor:
        """Normalize and activate what has been mapped already, (..., num_out) -> the same."""
        rows, norm = mapped.reshape(-1, mapped.shape[-1]), self.norm
        if len(rows) > 1:
            x = norm(rows).view(mapped.shape)
        else:
            # The last survivor of a tiny crop has no variance: the running statistics stand in.
            statistics = norm.running_mean, norm.running_var
            x = nn.functional.batch_norm(rows, *statistics, norm.weight, norm.bias, eps=norm.eps)
            x = x.view(mapped.shape)
        return nn.functional.leaky_relu(x, NEGATIVE_SLOPE) if self.activation else x


def gather(x: Tensor, indices: Tensor) -> Tensor:
    """Rows of `x` (N, C) at `indices` of any shape (..., ) -> (..., C)."""
    # index_select's backward is several times as fast as indexing's on a CPU.
    return x.index_select(0, indices.reshape(-1)).view(*indices.shape, x.shape[1])


def in_chunks(function: Callable[..., Tensor], size: int, *rows: Tensor) -> Tensor:
    """Apply a function that treats rows independently, `size` rows at a time.

    Without gradients a neighborhood's intermediate tensors are K times as large as its result and
    needed once: chunks small enough for the processor's cache are faster and bound the memory.
    With gradients (and so with batch statistics) everything is done at once.

    Args:
        function: Takes the chunks of `rows`, returns one tensor with as many rows.
        size: Rows in a chunk.
        rows: Tensors of the same number of rows.

    Returns:
        The function's result for all rows.
    """
    num_rows = len(rows[0])
    if torch.is_grad_enabled() or num_rows <= size:
        return function(*rows)
    starts = range(0, num_rows, size)
    return torch.cat([function(*(tensor[s : s + size] for tensor in rows)) for s in starts])
