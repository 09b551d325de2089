"""Local multidimensional feature fusion, LMFF (section 3.3): up to three channels, side by side.

Position (SPO), the points' features (color and what the layer below learned) and SPF, each lifted
by its own shared MLP to the same width. Position and SPF can be switched off (Table 3). The
features come in already lifted: by the residual block's first MLP, or by the block before.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from bushseg.config import NetworkConfig
from bushseg.models.attention import ATTENTION, AttentivePooling, MultiChannelAttention
from bushseg.models.batch import Level
from bushseg.models.chunks import in_chunks, run_chunks
from bushseg.models.layers import SharedMLP, gather
from bushseg.models.pair_geometry import describe_kernel
from bushseg.models.pooling import attentive_pool
from bushseg.ranks import current
from bushseg.spf import simple_point_features

POSITION_WIDTH = {"relative": 4, "absolute": 10}
SPF_WIDTH = 3


@dataclass(frozen=True, slots=True)
class Geometry:
    """What a level's neighborhoods look like, shared by both blocks of its encoder.

    Attributes:
        neighbors: Neighbor indices, (N, K) int32.
        columns: Position encoding, then (alpha, phi, theta), those that are on, then a one:
            (N, K, G).
        moments: Sums of the products of every two columns, those of other processes included,
            (G, G) float64, the last being the number of pairs; None where the network's running
            statistics count, or normalization takes its own (the plain path).
    """

    neighbors: Tensor
    columns: Tensor
    moments: Tensor | None

    @classmethod
    def of(cls, level: Level, config: NetworkConfig, *, with_moments: bool) -> "Geometry":
        """Compute what the configuration asks for.

        Args:
            level: The level.
            config: The switches.
            with_moments: Whether the lifts are normalized by these pairs' own statistics.
        """
        fast = level.xyz.device.type == "cpu" and level.xyz.dtype == torch.float32
        columns = (describe_fast if fast else describe)(level, config)
        sums = current().total(moments(columns)) if with_moments and fast else None
        return cls(level.neighbors, columns, sums)


def describe(level: Level, config: NetworkConfig) -> Tensor:
    """The columns of :class:`Geometry`, on any device and in any precision."""
    parts = []
    if config.spo:
        absolute = config.position == "absolute"
        parts.append(encode_position(level.xyz, level.neighbors, absolute=absolute))
    if config.spf:
        parts.append(simple_point_features(level.xyz, level.normals, level.neighbors))
    one = torch.ones(1, 1, 1, dtype=level.xyz.dtype, device=level.xyz.device)
    return torch.cat([*parts, one.expand(*level.neighbors.shape, 1)], dim=2)


def describe_fast(level: Level, config: NetworkConfig) -> Tensor:
    """The same in float32, compiled, on all cores."""
    num_position = POSITION_WIDTH[config.position] if config.spo else 0
    num_columns = num_position + SPF_WIDTH * config.spf + 1
    columns = torch.empty(*level.neighbors.shape, num_columns)
    written = columns.numpy()
    xyz, normals = level.xyz.numpy(), level.normals.numpy()
    neighbors = level.neighbors.numpy()
    kernel = describe_kernel(neighbors.shape[1], num_position, config.spf)

    def call(start: int, stop: int) -> None:
        kernel(xyz, normals, neighbors, start, stop, written[start:stop])

    run_chunks(call, len(xyz), 4096)
    return columns


def moments(columns: Tensor) -> Tensor:
    """Sum of the products of every two columns over all pairs, (N, K, G) -> (G, G) float64."""
    # Sums of a few thousand in float32, sums of these in float64: no digit that counts is lost.
    total = torch.zeros(columns.shape[2], columns.shape[2], dtype=torch.float64)
    for part in torch.split(columns, 512):
        rows = part.flatten(0, 1)
        total += (rows.T @ rows).double().cpu()
    return total


def encode_position(xyz: Tensor, neighbors: Tensor, *, absolute: bool) -> Tensor:
    """Relative position encoding, SPO.

    Args:
        xyz: Positions, (N, 3).
        neighbors: Neighbor indices, (N, K).
        absolute: Whether p_i and p_k precede (p_i - p_k, d), as in RandLA-Net.

    Returns:
        (N, K, 4), or (N, K, 10) with the absolute positions.
    """
    p_k = gather(xyz, neighbors)
    p_i = xyz[:, None].expand_as(p_k)
    offset = p_i - p_k
    distance = offset.norm(dim=2, keepdim=True)
    parts = [p_i, p_k, offset, distance] if absolute else [offset, distance]
    return torch.cat(parts, dim=2)


class FusionBlock(nn.Module):
    """One LMFF and the attention that pools it (an LFMA of Fig. 1).

    Args:
        width: Width of the incoming features and of each channel.
        num_out: Width of the outgoing features.
        config: The switches.
    """

    def __init__(self, width: int, num_out: int, config: NetworkConfig) -> None:
        super().__init__()
        self.num_out = num_out
        self.lifts = nn.ModuleList()
        self.spans: list[slice] = []
        """The geometry's columns that each lift takes."""
        for num_columns in (
            POSITION_WIDTH[config.position] * config.spo,
            SPF_WIDTH * config.spf,
        ):
            if num_columns:
                start = self.spans[-1].stop if self.spans else 0
                self.spans.append(slice(start, start + num_columns))
                self.lifts.append(SharedMLP(num_columns, width))
        fused = width * (1 + len(self.lifts))
        self.attention = ATTENTION[config.attention](fused)
        self.mlp = SharedMLP(fused, num_out)

    def forward(self, x: Tensor, geometry: Geometry) -> Tensor:
        """Features (N, width) -> (N, num_out)."""
        mlp, attention = self.mlp.step(), self.attention
        fast = x.device.type == "cpu" and x.dtype == torch.float32
        if fast and isinstance(attention, (AttentivePooling, MultiChannelAttention)):
            pooled = attentive_pool(
                x,
                geometry.neighbors,
                geometry.columns,
                self._lift(geometry),
                attention.scores.weight,
            )
            return in_chunks(lambda *parts: mlp(attention.combine(*parts)), self.num_out, *pooled)
        lifts = [lift.step() for lift in self._lifts()]

        def pool(neighbors: Tensor, columns: Tensor) -> Tensor:
            channels = [
                lift(columns[..., span]) for lift, span in zip(lifts, self.spans, strict=True)
            ]
            fused = torch.cat([gather(x, neighbors), *channels], dim=2)  # (n, K, fused)
            return mlp(attention(fused))

        return in_chunks(pool, self.num_out, geometry.neighbors, geometry.columns, size=4096)

    def _lifts(self) -> list[SharedMLP]:
        return [lift for lift in self.lifts if isinstance(lift, SharedMLP)]

    def _lift(self, geometry: Geometry) -> Tensor:
        """All lifts as one linear map of the geometry's columns, (G, lifted).

        Normalization of a linear map of few columns needs their moments alone: the mean of W g is
        W mean(g), its variance the diagonal of W cov(g) W^T.
        """
        blocks = []
        for lift, span in zip(self._lifts(), self.spans, strict=True):
            weight, bias = lift.affine(*_statistics(lift, geometry, span))
            before, after = span.start, self.spans[-1].stop - span.stop
            blocks.append(
                torch.cat([nn.functional.pad(weight.T, (0, 0, before, after)), bias[None]])
            )
        if not blocks:
            return torch.empty(1, 0)
        return torch.cat(blocks, dim=1)


def _statistics(
    lift: SharedMLP, geometry: Geometry, span: slice
) -> tuple[Tensor | None, Tensor | None]:
    """Mean and variance of what a lift's linear map gives; None where the running ones count."""
    if geometry.moments is None:
        return None, None
    count = geometry.moments[-1, -1]
    weight, center = lift.linear.weight.double(), geometry.moments[span, -1] / count
    covariance = geometry.moments[span, span] / count - center[:, None] * center
    mean = weight @ center
    variance = ((weight @ covariance) * weight).sum(dim=1).clamp_min(0)
    lift.observe(mean, variance, int(count))
    return mean.float(), variance.float()
