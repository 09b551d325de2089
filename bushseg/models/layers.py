"""Shared multi-layer perceptrons and gathering, over points laid end to end."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from bushseg.models.kernels import SLOPE
from bushseg.models.shared_norm import drop_out, normalize
from bushseg.ranks import current


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
        return self.step()(x)

    def step(self) -> Callable[[Tensor], Tensor]:
        """What `forward` does, to be applied to many chunks of points.

        With fixed statistics, normalization is part of the linear map: merged once, not a chunk.
        """
        if self.training:
            return lambda x: self.finish(self.linear(x))
        weight, bias = self.affine()
        return lambda x: self._activate(nn.functional.linear(x, weight, bias))

    def split_step(self) -> tuple[Callable[[Tensor], Tensor], Tensor]:
        """What follows the linear map, and the map's weight: for inputs that come in parts."""
        if self.training:
            return self.finish, self.linear.weight
        weight, bias = self.affine()
        return lambda mapped: self._activate(mapped.add_(bias)), weight

    def affine(
        self, mean: Tensor | None = None, variance: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """The linear map and normalization as one: (num_out, num_in) and (num_out,).

        Args:
            mean: Of what `linear` gives, (num_out,); None takes the running statistics.
            variance: Likewise.
        """
        norm = self.norm
        if mean is None or variance is None:
            assert norm.running_mean is not None
            assert norm.running_var is not None
            mean, variance = norm.running_mean, norm.running_var
        scale = norm.weight * torch.rsqrt(variance + norm.eps)
        return self.linear.weight * scale[:, None], norm.bias - mean * scale

    @torch.no_grad()
    def observe(self, mean: Tensor, variance: Tensor, num_rows: int) -> None:
        """Move the running statistics as normalizing these rows would have.

        Args:
            mean: Of what `linear` gave for the rows, (num_out,).
            variance: Likewise, over `num_rows`, not one less.
            num_rows: How many rows.
        """
        norm = self.norm
        assert norm.running_mean is not None
        assert norm.running_var is not None
        assert norm.num_batches_tracked is not None
        norm.num_batches_tracked += 1
        share = norm.momentum if norm.momentum is not None else 1 / int(norm.num_batches_tracked)
        unbiased = variance * (num_rows / max(1, num_rows - 1))
        norm.running_mean.lerp_(mean.to(norm.running_mean.dtype), share)
        norm.running_var.lerp_(unbiased.to(norm.running_var.dtype), share)

    def finish(self, mapped: Tensor) -> Tensor:
        """Normalize and activate what has been mapped already, (..., num_out) -> the same."""
        rows, norm = mapped.reshape(-1, mapped.shape[-1]), self.norm
        if current().size > 1:
            x, mean, variance, num_rows = normalize(rows, norm)
            if num_rows > 1:
                self.observe(mean, variance, num_rows)
            x = x.view(mapped.shape)
        elif len(rows) > 1:
            x = norm(rows).view(mapped.shape)
        else:
            # The last survivor of a tiny crop has no variance: the running statistics stand in.
            statistics = norm.running_mean, norm.running_var
            x = nn.functional.batch_norm(rows, *statistics, norm.weight, norm.bias, eps=norm.eps)
            x = x.view(mapped.shape)
        return self._activate(x)

    def _activate(self, x: Tensor) -> Tensor:
        return nn.functional.leaky_relu_(x, SLOPE) if self.activation else x


class Dropout(nn.Dropout):
    """Drop-out that is the same however the rows are shared out to processes."""

    def forward(self, x: Tensor) -> Tensor:
        """(N, C) -> (N, C)."""
        if not self.training or current().size == 1:
            return super().forward(x)
        return drop_out(x, self.p)


def gather(x: Tensor, indices: Tensor) -> Tensor:
    """Rows of `x` (N, C) at `indices` of any shape (..., ) -> (..., C)."""
    # index_select's backward is several times as fast as indexing's on a CPU.
    return x.index_select(0, indices.reshape(-1)).view(*indices.shape, x.shape[1])
