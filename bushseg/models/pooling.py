"""Attentive pooling of a neighborhood's fused channels, in one pass that stays in the cache.

What `lmff.py` and `attention.py` say in a line each (gather the neighbors' features, lift position
and SPF, score, softmax over the neighbors, sum) takes a dozen passes over tensors of N K C numbers
as PyTorch runs it. Here a few hundred points are taken through all of it at a time, on all cores:

- a linear map of gathered features equals gathering mapped features, so the features' share of the
  scores is computed once a point, not once a pair;
- batch normalization of a lift is an affine map whose statistics follow from the moments of its few
  input columns, so lifting is one product;
- nothing of size N K C is stored: the backward pass computes its chunk again.
"""

import math
import threading
from typing import Any

import torch
from torch import Tensor

from bushseg.models import kernels
from bushseg.models.chunks import in_chunks, run_chunks
from bushseg.parallel import num_workers

_CHUNK_FLOATS = 1_000_000
"""What a chunk's two arrays over pairs hold, about: 4 MB, a few times a core's second-level cache.
Smaller chunks stay in it and lose more to the calls between the loops than they gain."""


def attentive_pool(
    x: Tensor, neighbors: Tensor, columns: Tensor, lift: Tensor, score: Tensor
) -> tuple[Tensor, Tensor]:
    """Pool each neighborhood's channels by attention, and plainly.

    The channels of a pair are the neighbor's features and the lifted geometry,
    f = [x_k, leaky_relu(columns lift)]; the weights are the softmax over the neighbors of score f.

    Args:
        x: Features, (N, width), float32.
        neighbors: Neighbor indices, (N, K), int32.
        columns: Geometry of each pair, (N, K, G), float32, not differentiated.
        lift: (G, L).
        score: (C, C) with C = width + L.

    Returns:
        Weighted sum and mean over the neighbors, (N, C) each.
    """
    pooled, mean = _AttentivePool.apply(x, neighbors, columns, lift, score)  # type: ignore[no-untyped-call]
    return pooled, mean


class _AttentivePool(torch.autograd.Function):
    """The function above and its gradients."""

    @staticmethod
    def forward(
        ctx: Any, x: Tensor, neighbors: Tensor, columns: Tensor, lift: Tensor, score: Tensor
    ) -> tuple[Tensor, Tensor]:
        work = _Work(x, neighbors, columns, lift, score)
        pooled = torch.empty(len(x), len(score))
        mean = torch.empty(len(x), len(score))
        run_chunks(
            lambda start, stop: work.forward(start, stop, pooled[start:stop], mean[start:stop]),
            len(x),
            work.chunk,
        )
        ctx.save_for_backward(x, neighbors, columns, lift, score, pooled)
        ctx.huge = work.huge
        return pooled, mean

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        x, neighbors, columns, lift, score, pooled = ctx.saved_tensors
        d_pooled, d_mean = (gradient.contiguous() for gradient in gradients)
        work, num_rows = _Work(x, neighbors, columns, lift, score, huge=ctx.huge), len(x)
        # A share of the rows each, and sums of its own: the order of addition is always the same.
        share = max(1, -(-num_rows // num_workers()))
        sums = [_Sums(x, lift, score) for _ in range(max(1, -(-num_rows // share)))]

        def call(start: int, stop: int) -> None:
            for first in range(start, stop, work.chunk):
                rows = slice(first, min(first + work.chunk, stop))
                work.backward(
                    rows, pooled[rows], d_pooled[rows], d_mean[rows], sums[start // share]
                )

        run_chunks(call, num_rows, share)
        total, *others = sums
        for other in others:
            total += other
        width = x.shape[1]
        d_x = total.x.addmm_(total.mapped, score[:, :width])
        d_score = torch.cat([total.mapped.T @ x, total.score], dim=1)
        return d_x, None, None, total.lift, d_score


class _Sums:
    """Gradients that one worker adds up."""

    def __init__(self, x: Tensor, lift: Tensor, score: Tensor) -> None:
        width = x.shape[1]
        self.x = torch.zeros(x.shape)
        self.mapped = torch.zeros(len(x), len(score))
        self.lift = torch.zeros(lift.shape)
        self.score = torch.zeros(len(score), len(score) - width)

    def __iadd__(self, other: "_Sums") -> "_Sums":
        for name, mine in vars(self).items():
            mine += getattr(other, name)
        return self


class _Work:
    """A chunk of points through the function, and back.

    Attributes:
        huge: Whether there are scores whose exponentials overflow, or vanish for all neighbors.
    """

    def __init__(
        self,
        x: Tensor,
        neighbors: Tensor,
        columns: Tensor,
        lift: Tensor,
        score: Tensor,
        *,
        huge: bool = False,
    ) -> None:
        self.huge = huge
        self.width = x.shape[1]
        self.x = x.detach().contiguous()
        to_scores = score.detach()[:, : self.width].T
        # The features' share of the scores.
        self.mapped = in_chunks(lambda rows: rows @ to_scores, len(score), self.x, size=4096)
        self.neighbors = neighbors.numpy()
        self.columns = columns.detach()
        self.lift = lift.detach().contiguous()
        self.score = score.detach()[:, self.width :].contiguous()
        self.k, self.channels = neighbors.shape[1], len(score)
        self.chunk = max(1, _CHUNK_FLOATS // (self.k * 2 * self.channels))
        self.kernels = kernels.pair_kernels(self.k, columns.shape[2])
        self._local = threading.local()

    def forward(self, start: int, stop: int, pooled: Tensor, mean: Tensor) -> None:
        """Pool points start to stop into `pooled` and `mean`."""
        fused, scores = self._fuse(start, stop)
        scores.exp_()
        out = pooled.numpy(), mean.numpy()
        if not math.isfinite(self.kernels.pool(scores.numpy(), fused.numpy(), *out)):
            self.huge = True
            fused, scores = self._fuse(start, stop)
            _weigh(scores, self.k)
            self.kernels.pool(scores.numpy(), fused.numpy(), *out)

    def backward(
        self, rows: slice, pooled: Tensor, d_pooled: Tensor, d_mean: Tensor, sums: _Sums
    ) -> None:
        """Add the gradients of a chunk's points to `sums`."""
        fused, scores = self._fuse(rows.start, rows.stop)
        if self.huge:
            _weigh(scores, self.k)
        else:
            scores.exp_()
        (d_fused,) = self._buffers(len(scores), "d_fused")
        tensors = scores, fused, pooled, d_pooled, d_mean, d_fused
        self.kernels.pool_backward(*(tensor.numpy() for tensor in tensors))
        lifted, d_lifted = fused[:, self.width :], d_fused[:, self.width :]
        sums.score.addmm_(scores.T, lifted)
        d_lifted.addmm_(scores, self.score)
        kernels.leak_gradients(d_fused.numpy(), fused.numpy(), self.width)
        sums.lift.addmm_(self.columns[rows].flatten(0, 1).T, d_lifted)
        around = self.neighbors, rows.start, rows.stop
        kernels.scatter_rows(d_fused.numpy(), *around, sums.x.numpy())
        kernels.scatter_rows(scores.numpy(), *around, sums.mapped.numpy())

    def _fuse(self, start: int, stop: int) -> tuple[Tensor, Tensor]:
        """Channels and scores of a chunk's pairs, (pairs, C) each."""
        fused, scores = self._buffers((stop - start) * self.k, "fused", "scores")
        arrays = (t.numpy() for t in (self.x, self.mapped))
        self.kernels.fuse(
            *arrays,
            self.neighbors,
            self.columns.numpy(),
            self.lift.numpy(),
            start,
            stop,
            fused.numpy(),
            scores.numpy(),
        )
        # Of as many rows each time, the last of a smaller chunk being of no use (see `chunks.py`).
        all_fused, all_scores = self._buffers(self.chunk * self.k, "fused", "scores")
        all_scores.addmm_(all_fused[:, self.width :], self.score.T)
        return fused, scores

    def _buffers(self, num_pairs: int, *names: str) -> list[Tensor]:
        """This thread's arrays over pairs: allocating anew would cost as much as filling them."""
        kept: dict[str, Tensor] = self._local.__dict__
        for name in names:
            if name not in kept:
                # PyTorch's memory is aligned: products then round the same way every time.
                kept[name] = torch.empty(self.chunk * self.k, self.channels)
        return [kept[name][:num_pairs] for name in names]


def _weigh(scores: Tensor, k: int) -> None:
    """Scores to exponentials, in place: less their greatest, they neither overflow nor all vanish.

    Args:
        scores: (pairs, C).
        k: K.
    """
    by_point = scores.view(-1, k, scores.shape[1])
    by_point.sub_(by_point.amax(dim=1, keepdim=True)).exp_()
