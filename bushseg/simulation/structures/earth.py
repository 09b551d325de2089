"""Rocks and heaps: ground, as far as labels go."""

import numpy as np

from bushseg.simulation.materials import GRAVEL, SOIL, STONE
from bushseg.simulation.mesh import Mesh, Model, Surface, ellipsoid


def rock(rng: np.random.Generator, size: float) -> Model:
    """A boulder about `size` metres across, a third of it in the ground."""
    radii = 0.5 * size * rng.uniform((0.8, 0.6, 0.45), (1.2, 1.0, 0.9))
    ball = ellipsoid((0, 0, 0), (1, 1, 1), sides=9).vertices.astype(np.float64)
    lumps = np.sin(ball @ rng.normal(0, 2.5, (3, 4)) + rng.uniform(0, 2 * np.pi, 4)).sum(axis=1)
    vertices = ball * (1 + 0.1 * lumps[:, None]) * radii + (0, 0, 0.35 * radii[2])
    return [Surface(Mesh.of(vertices, ellipsoid((0, 0, 0), (1, 1, 1), sides=9).triangles), STONE)]


def heap(rng: np.random.Generator, radius: float) -> Model:
    """A heap of soil or gravel, tipped: a cone of about 35 degrees with a blunt top."""
    rings, sides = 8, 24
    out = np.linspace(0, 1.05, rings)
    turn = np.arange(sides) * (2 * np.pi / sides)
    shape = 1 + 0.15 * np.sin(turn * rng.integers(1, 4) + rng.uniform(0, 6.28))
    r = radius * out[:, None] * shape
    z = 0.62 * radius * (1 - out[:, None] ** 1.3) * rng.uniform(0.85, 1.1, (rings, sides))
    z[0], z[-1] = z[0].mean(), -0.15
    vertices = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1).reshape(-1, 3)
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    triangles = np.stack([a, b, b + sides, a, b + sides, a + sides], axis=-1).reshape(-1, 3)
    return [Surface(Mesh.of(vertices, triangles), (SOIL, GRAVEL)[rng.integers(2)])]
