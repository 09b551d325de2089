"""The ground: a heightfield."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from bushseg.config import Positive, Section
from bushseg.points import FloatArray
from bushseg.simulation.mesh import Mesh
from bushseg.simulation.ranges import Range


class TerrainConfig(Section):
    """How the ground is shaped, wherever it is."""

    cell: float | None = Field(
        None,
        ge=0.1,
        le=2,
        description="Grid spacing, metres; None: a two-hundredth of the site, 0.2 to 0.4",
    )
    slope: Range | None = Field(
        None, description="Steepest general slope, degrees; None: what the place has"
    )
    relief: Range | None = Field(
        None,
        description="Standard deviation of heights about that slope, metres; None: what the "
        "place has",
    )
    shortest_wave: Positive = Field(6.0, description="Shortest knolls and hollows, metres")
    longest_wave: Positive = Field(40.0, description="Longest knolls and hollows, metres")

    def spacing(self, size: float) -> float:
        """Grid spacing for a site of `size` metres, such that cells fit it exactly."""
        wanted = float(np.clip(size / 200, 0.2, 0.4)) if self.cell is None else self.cell
        return size / np.ceil(size / wanted)


@dataclass(frozen=True, slots=True)
class Terrain:
    """Heights on a square grid, with flat triangles between them.

    Attributes:
        heights: Metres at (x, y) = (i, j) * cell, shape (M, M), float64.
        cell: Grid spacing, metres.
    """

    heights: FloatArray
    cell: float

    def height(self, xy: FloatArray) -> FloatArray:
        """The ground's height, exactly as its triangles have it.

        Args:
            xy: Places in metres, shape (N, 2); beyond the edge its triangles are carried on.

        Returns:
            Heights in metres, shape (N,), float64.
        """
        last = len(self.heights) - 2
        i, j = np.clip((xy // self.cell).astype(np.intp), 0, last).T
        fx, fy = (xy / self.cell - np.stack([i, j], axis=1)).T
        h00, h10 = self.heights[i, j], self.heights[i + 1, j]
        h01, h11 = self.heights[i, j + 1], self.heights[i + 1, j + 1]
        lower = h00 + fx * (h10 - h00) + fy * (h01 - h00)
        upper = h11 + (1 - fx) * (h01 - h11) + (1 - fy) * (h10 - h11)
        return np.where(fx + fy <= 1, lower, upper)

    def point(self, xy: FloatArray) -> FloatArray:
        """The place (3,) on the ground at `xy` (2,), metres."""
        return np.array([*xy, self.height(xy[None])[0]])

    def mesh(self) -> Mesh:
        """The whole ground."""
        side = len(self.heights)
        x, y = np.meshgrid(*[np.arange(side) * self.cell] * 2, indexing="ij")
        i, j = np.meshgrid(*[np.arange(side - 1)] * 2, indexing="ij")
        a = i * side + j
        triangles = np.stack([a, a + side, a + 1, a + side + 1, a + 1, a + side], axis=-1)
        vertices = np.stack([x, y, self.heights], axis=-1)
        return Mesh.of(vertices.reshape(-1, 3), triangles.reshape(-1, 3))


def make_terrain(
    rng: np.random.Generator,
    config: TerrainConfig,
    size: float,
    *,
    slope: float,
    relief: float,
    roughness: float,
) -> Terrain:
    """Draw a terrain: a slope, knolls and hollows, and roughness.

    Args:
        rng: Source of randomness.
        config: Grid spacing and wavelengths.
        size: Edge of the site, metres.
        slope: Steepest general slope, degrees.
        relief: Standard deviation of heights about it, metres.
        roughness: Standard deviation of heights from cell to cell, metres.
    """
    cell = config.spacing(size)
    side = round(size / cell) + 1
    at = np.arange(side) * cell
    xy = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2)
    azimuth = rng.uniform(0, 2 * np.pi)
    steepness = np.tan(np.radians(slope)) * rng.uniform(0.4, 1)
    plane = xy @ np.array([np.cos(azimuth), np.sin(azimuth)]) * steepness
    knolls = relief * waves(
        rng,
        xy,
        shortest=config.shortest_wave,
        longest=max(config.longest_wave, config.shortest_wave),
    )
    rough = roughness * rng.standard_normal(len(xy))
    rough += 0.7 * roughness * waves(rng, xy, shortest=0.8, longest=3)
    return Terrain((plane + knolls + rough).reshape(side, side), cell)


def waves(
    rng: np.random.Generator, xy: FloatArray, *, shortest: float, longest: float, number: int = 12
) -> FloatArray:
    """Smooth noise of unit variance: a sum of plane waves in all directions.

    Args:
        rng: Source of randomness.
        xy: Places in metres, shape (N, 2).
        shortest: Shortest wavelength, metres.
        longest: Longest wavelength, metres.
        number: How many waves.

    Returns:
        Values, shape (N,), float64.
    """
    angles = rng.uniform(0, 2 * np.pi, number)
    numbers = 2 * np.pi / np.geomspace(shortest, longest, number)
    amplitudes = 1 / numbers  # longer waves are higher, as in nature
    amplitudes *= np.sqrt(2 / np.sum(amplitudes**2))
    phase = xy @ (np.stack([np.cos(angles), np.sin(angles)]) * numbers)
    return np.sin(phase + rng.uniform(0, 2 * np.pi, number)) @ amplitudes
