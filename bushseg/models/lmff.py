"""Local multidimensional feature fusion, LMFF (section 3.3): up to three channels, side by side.

Position (SPO), the points' features (color and what the layer below learned) and SPF, each lifted
by its own shared MLP to the same width. Position and SPF can be switched off (Table 3). The
features come in already lifted: by the residual block's first MLP, or by the block before.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from bushseg.config import NetworkConfig
from bushseg.models.attention import ATTENTION
from bushseg.models.batch import Level
from bushseg.models.layers import SharedMLP, gather, in_chunks
from bushseg.spf import simple_point_features

CHUNK = 4096
"""Neighborhoods handled at once without gradients; measured in benchmarks/RESULTS.md."""

POSITION_WIDTH = {"relative": 4, "absolute": 10}


@dataclass(frozen=True, slots=True)
class Geometry:
    """What a level's neighborhoods look like, shared by both blocks of its encoder.

    Attributes:
        neighbors: Neighbor indices, (N, K) int64.
        position: Position encoding, (N, K, 4 or 10), or None where SPO is off.
        spf: (alpha, phi, theta), (N, K, 3), or None where SPF is off.
    """

    neighbors: Tensor
    position: Tensor | None
    spf: Tensor | None

    @classmethod
    def of(cls, level: Level, config: NetworkConfig) -> "Geometry":
        """Compute what the configuration asks for."""
        spf = None
        if config.spf:
            spf = simple_point_features(level.xyz, level.normals, level.neighbors)
        position = None
        if config.spo:
            position = encode_position(
                level.xyz, level.neighbors, absolute=config.position == "absolute"
            )
        return cls(level.neighbors, position, spf)

    @property
    def columns(self) -> tuple[Tensor, ...]:
        """The channels that are on."""
        return tuple(channel for channel in (self.position, self.spf) if channel is not None)


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
        self.lifts = nn.ModuleList()
        if config.spo:
            self.lifts.append(SharedMLP(POSITION_WIDTH[config.position], width))
        if config.spf:
            self.lifts.append(SharedMLP(3, width))
        fused = width * (1 + len(self.lifts))
        self.attention = ATTENTION[config.attention](fused)
        self.mlp = SharedMLP(fused, num_out)

    def forward(self, x: Tensor, geometry: Geometry) -> Tensor:
        """Features (N, width) -> (N, num_out)."""

        def pool(neighbors: Tensor, *columns: Tensor) -> Tensor:
            channels = [lift(column) for lift, column in zip(self.lifts, columns, strict=True)]
            fused = torch.cat([gather(x, neighbors), *channels], dim=2)  # (n, K, fused)
            pooled: Tensor = self.mlp(self.attention(fused))
            return pooled

        return in_chunks(pool, CHUNK, geometry.neighbors, *geometry.columns)
