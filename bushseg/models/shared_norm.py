"""Normalization and drop-out of rows that several processes hold, as if one held them all.

Each process has some of a step's crops. Statistics are taken over the rows of all of them, and
gradients flow through that sum, so that the network learns the same however crops are shared out.
"""

from typing import Any

import torch
from torch import Tensor, nn

from bushseg.ranks import Ranks, current


def normalize(rows: Tensor, norm: nn.BatchNorm1d) -> tuple[Tensor, Tensor, Tensor, int]:
    """Batch normalization over the rows of all processes; running statistics are left alone.

    Args:
        rows: This process's rows, (N, C), maybe none.
        norm: Weights and running statistics, which stand in where there is one row in all.

    Returns:
        The normalized rows, (N, C); mean and (biased) variance over all rows, (C,) each; how many
        rows there are in all.
    """
    ranks = current()
    mean, variance, count = statistics(rows.detach(), ranks)
    if count <= 1:
        # The last survivor of a tiny crop has no variance.
        kept = norm.running_mean, norm.running_var
        x = nn.functional.batch_norm(rows, *kept, norm.weight, norm.bias, eps=norm.eps)
        return x, mean, variance, count
    scale = torch.rsqrt(variance + norm.eps)
    centered: Tensor = _Standardize.apply(rows, mean, scale, count, ranks)  # type: ignore[no-untyped-call]
    return centered * norm.weight + norm.bias, mean, variance, count


def statistics(rows: Tensor, ranks: Ranks) -> tuple[Tensor, Tensor, int]:
    """Mean, biased variance and number of all processes' rows, (N, C) -> (C,), (C,)."""
    width, own = rows.shape[1], len(rows)
    sums = torch.zeros(2 * width + 1, dtype=torch.float64, device=rows.device)
    if own:
        # Each process centers its own: float64 then adds up numbers of like size.
        variance, mean = torch.var_mean(rows, dim=0, correction=0)
        mean = mean.double()
        sums[:width] = own * mean
        sums[width:-1] = own * (variance.double() + mean**2)
        sums[-1] = own
    sums = ranks.total(sums)
    count = int(sums[-1])
    mean = sums[:width] / max(1, count)
    variance = (sums[width:-1] / max(1, count) - mean**2).clamp_min(0)
    return mean.to(rows.dtype), variance.to(rows.dtype), count


def drop_out(x: Tensor, share: float) -> Tensor:
    """Drop-out by the mask that one process would draw for all rows; this process's part of it.

    Args:
        x: This process's rows, (N, C).
        share: Chance of a number to be dropped.
    """
    ranks = current()
    counts = torch.zeros(ranks.size, dtype=torch.int64)
    counts[ranks.rank] = len(x)
    counts = ranks.total(counts)
    first = int(counts[: ranks.rank].sum())
    mask = nn.functional.dropout(x.new_ones(int(counts.sum()), *x.shape[1:]), share)
    return x * mask[first : first + len(x)]


class _Standardize(torch.autograd.Function):
    """(x - mean) / deviation, where both follow from all processes' x."""

    @staticmethod
    def forward(
        ctx: Any, rows: Tensor, mean: Tensor, scale: Tensor, count: int, ranks: Ranks
    ) -> Tensor:
        standard = (rows - mean) * scale
        ctx.save_for_backward(standard, scale)
        ctx.count, ctx.ranks = count, ranks
        return standard

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        standard, scale = ctx.saved_tensors
        (gradient,) = gradients
        # A row moves the mean and the deviation that all rows, anywhere, are standardized by.
        local = torch.stack([gradient.sum(dim=0), (gradient * standard).sum(dim=0)])
        through_mean, through_scale = ctx.ranks.total(local.double()).to(gradient.dtype) / ctx.count
        return (gradient - through_mean - standard * through_scale) * scale, None, None, None, None
