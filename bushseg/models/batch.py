"""What a network is fed: features, and the geometry and indices of every level."""

from dataclasses import dataclass
from typing import Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from bushseg.pyramid import Pyramid


@dataclass(frozen=True, slots=True)
class Level:
    """One level's points and their neighborhoods.

    Attributes:
        xyz: Positions in units of the level's spacing, (N, 3) float32.
        normals: Unit normals, (N, 3) float32.
        neighbors: Neighbor indices within the level, (N, K) int32.
        decimated: Survivors, indices into this level, (M,) int32.
        interpolated: Nearest survivor of each point, indices into the next level, (N,) int32.
    """

    xyz: Tensor
    normals: Tensor
    neighbors: Tensor
    decimated: Tensor
    interpolated: Tensor


@dataclass(frozen=True, slots=True)
class Batch:
    """One or more clouds laid end to end; their indices never cross.

    Attributes:
        features: Input features of level 0, (N, F) float32.
        levels: Level 0 (all points) first; each about a quarter of the one before.
    """

    features: Tensor
    levels: tuple[Level, ...]

    @classmethod
    def from_numpy(
        cls,
        features: NDArray[np.float32],
        xyz: NDArray[np.float32],
        normals: NDArray[np.float32],
        pyramid: Pyramid,
        spacing: float,
    ) -> Self:
        """Lay out one cloud.

        Args:
            features: (N, F) float32.
            xyz: Positions in metres relative to a nearby origin, (N, 3) float32.
            normals: Unit normals, (N, 3) float32.
            pyramid: The cloud's indices.
            spacing: Spacing of level 0 in metres (the voxel size). Each level's positions are
                divided by its own spacing, twice that of the level before (a quarter of the points
                of a surface), so that all encoders see neighborhoods of about the same size.
        """
        levels = []
        for depth in range(pyramid.num_levels):
            decimated = pyramid.decimated[depth]
            levels.append(
                Level(
                    torch.from_numpy(xyz / np.float32(spacing * 2**depth)),
                    torch.from_numpy(normals),
                    torch.from_numpy(pyramid.neighbors[depth]),
                    torch.from_numpy(decimated),
                    torch.from_numpy(pyramid.interpolated[depth]),
                )
            )
            xyz, normals = xyz[decimated], normals[decimated]
        return cls(torch.from_numpy(features), tuple(levels))

    @classmethod
    def concatenated(cls, batches: "list[Self]") -> Self:
        """Lay several batches end to end, their indices shifted."""
        levels = []
        for depth in range(len(batches[0].levels)):
            parts = [batch.levels[depth] for batch in batches]
            here = _offsets([len(part.xyz) for part in parts])
            below = _offsets([len(part.decimated) for part in parts])
            levels.append(
                Level(
                    torch.cat([part.xyz for part in parts]),
                    torch.cat([part.normals for part in parts]),
                    torch.cat([p.neighbors + o for p, o in zip(parts, here, strict=True)]),
                    torch.cat([p.decimated + o for p, o in zip(parts, here, strict=True)]),
                    torch.cat([p.interpolated + o for p, o in zip(parts, below, strict=True)]),
                )
            )
        return cls(torch.cat([batch.features for batch in batches]), tuple(levels))

    @classmethod
    def empty(cls, num_features: int, num_neighbors: int, num_levels: int) -> Self:
        """No points: the share of a process where there are fewer crops than processes."""
        rows, numbers = torch.empty(0, 3), torch.empty(0, dtype=torch.int32)
        neighbors = torch.empty(0, num_neighbors, dtype=torch.int32)
        level = Level(rows, rows, neighbors, numbers, numbers)
        return cls(torch.empty(0, num_features), (level,) * num_levels)

    def to(self, device: torch.device) -> Self:
        """Move everything to a device."""
        levels = tuple(
            Level(
                level.xyz.to(device),
                level.normals.to(device),
                level.neighbors.to(device),
                level.decimated.to(device),
                level.interpolated.to(device),
            )
            for level in self.levels
        )
        return type(self)(self.features.to(device), levels)


def _offsets(sizes: list[int]) -> list[int]:
    """Where each of several parts begins once laid end to end."""
    return [sum(sizes[:index]) for index in range(len(sizes))]
