"""Leaves: one triangle each, of given sizes and inclinations."""

from dataclasses import dataclass

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.mesh import Mesh
from bushseg.simulation.plants.branches import unit
from bushseg.simulation.plants.config import LeafAngles

_THETA = np.linspace(0, np.pi / 2, 91)

DENSITIES = {
    "spherical": np.sin(_THETA),
    "planophile": 1 + np.cos(2 * _THETA),
    "erectophile": 1 - np.cos(2 * _THETA),
    "plagiophile": 1 - np.cos(4 * _THETA),
}
"""Densities of leaf inclinations after de Wit (1965), by name, at 0 to 90 degrees."""

LARGEST = 6.0
"""Leaves are drawn at most so many times over life-size; rather a plant is too thin."""


@dataclass(frozen=True, slots=True)
class LeafKind:
    """What a plant's leaves are like.

    Attributes:
        length: Metres.
        aspect: Width over length.
        angles: Their distribution of inclinations.
    """

    length: float
    aspect: float
    angles: LeafAngles

    def area(self) -> float:
        """One side of a leaf, square metres."""
        return 0.5 * self.aspect * self.length**2


def inclinations(rng: np.random.Generator, angles: LeafAngles, number: int) -> FloatArray:
    """Draw angles (N,) between leaves and the horizontal, radians."""
    density = DENSITIES[angles]
    cumulated = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2)])
    drawn: FloatArray = np.interp(rng.uniform(0, cumulated[-1], number), cumulated, _THETA)
    return drawn


def number_and_scale(area: float, kind: LeafKind, most: float) -> tuple[int, float]:
    """How many leaves make up `area` square metres, and how much over life-size they are then.

    Args:
        area: One-sided leaf area wanted, square metres.
        kind: The leaves.
        most: The most leaves there may be.
    """
    wanted = area / kind.area()
    number = max(int(min(wanted, most)), 1)
    return number, float(np.clip(np.sqrt(wanted / number), 1, LARGEST))


def leaves(
    rng: np.random.Generator,
    positions: FloatArray,
    headings: FloatArray,
    kind: LeafKind,
    scale: float = 1.0,
) -> Mesh:
    """Put a leaf at each position.

    Args:
        rng: Source of randomness.
        positions: Where leaves join their twigs, metres, shape (N, 3).
        headings: Where they point as far as their inclination lets them, shape (N, 3).
        kind: Their size and inclinations; sizes vary by a third.
        scale: Factor on the size.
    """
    number = len(positions)
    theta, phi = inclinations(rng, kind.angles, number), rng.uniform(0, 2 * np.pi, number)
    sin = np.sin(theta)
    normals = np.stack([sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)], axis=1)
    wish = headings + 0.8 * rng.standard_normal((number, 3))
    along = unit(wish - np.einsum("ij,ij->i", wish, normals)[:, None] * normals)
    across = np.cross(normals, along)
    # The mean of the squares of 0.67 to 1.33 is 1.036: take that off, so that the area is right.
    length = (scale * kind.length / np.sqrt(1.036) * rng.uniform(0.67, 1.33, number))[:, None]
    half = 0.5 * kind.aspect * length
    corners = np.empty((number, 3, 3))
    corners[:, 0] = positions
    corners[:, 1] = positions + length * along - half * across
    corners[:, 2] = positions + length * along + half * across
    return Mesh.of(corners.reshape(-1, 3), np.arange(3 * number).reshape(-1, 3))
