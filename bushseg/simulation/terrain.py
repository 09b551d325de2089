"""The ground: a gentle heightfield, and what it is covered with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.materials import GRAVEL, LAWN, SOIL
from bushseg.simulation.mesh import Mesh, Model, Surface

CELL = 0.4
DRIVE_WIDTH = 3.0


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


def make_terrain(rng: np.random.Generator, config: SimulateConfig) -> Terrain:
    """Draw a terrain: a slope, knolls and hollows, and roughness of a centimetre or two."""
    side = int(np.ceil(config.size / CELL)) + 1
    x, y = np.meshgrid(*[np.arange(side) * CELL] * 2, indexing="ij")
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    azimuth = rng.uniform(0, 2 * np.pi)
    steepness = np.tan(np.radians(config.slope)) * rng.uniform(0.4, 1)
    plane = xy @ np.array([np.cos(azimuth), np.sin(azimuth)]) * steepness
    knolls = config.relief * waves(rng, xy, shortest=8, longest=30)
    roughness = 0.015 * rng.standard_normal(len(xy))
    return Terrain((plane + knolls + roughness).reshape(side, side), CELL)


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


def cover(rng: np.random.Generator, terrain: Terrain, drive: FloatArray | None) -> Model:
    """Clothe the terrain in lawn, bare soil and, along the drive, gravel.

    Args:
        rng: Source of randomness.
        terrain: The ground.
        drive: The ends of a drive, metres, shape (2, 2), or None.

    Returns:
        Surfaces that together are the whole ground, each triangle once.
    """
    mesh = terrain.mesh()
    centers = mesh.vertices[mesh.triangles].mean(axis=1)[:, :2].astype(np.float64)
    kind = (waves(rng, centers, shortest=3, longest=15) > 0.9).astype(np.intp)
    kind[on_drive(centers, drive)] = 2
    return [
        Surface(Mesh(mesh.vertices, mesh.triangles[kind == index]), material)
        for index, material in enumerate((LAWN, SOIL, GRAVEL))
        if np.any(kind == index)
    ]


def on_drive(xy: FloatArray, drive: FloatArray | None) -> NDArray[np.bool_]:
    """Which of `xy` (N, 2) lie on the drive (2, 2), `DRIVE_WIDTH` wide; none without a drive."""
    if drive is None:
        return np.zeros(len(xy), dtype=bool)
    along = drive[1] - drive[0]
    t = np.clip((xy - drive[0]) @ along / (along @ along), 0, 1)
    return np.linalg.norm(xy - drive[0] - t[:, None] * along, axis=1) < DRIVE_WIDTH / 2
