"""Wood as curves: stems, the branches that leave them, the twigs on those, all as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bushseg.points import FloatArray
from bushseg.simulation.mesh import Mesh, tubes

UP = np.array([0.0, 0.0, 1.0])

THINNEST = 0.0012
"""No twig is thinner than this, metres."""


@dataclass(frozen=True, slots=True)
class Branches:
    """N curves of K knots each.

    Attributes:
        paths: Knots from foot to tip, metres, shape (N, K, 3), float64.
        radii: Half the thickness at each knot, metres, shape (N, K), float64.
    """

    paths: FloatArray
    radii: FloatArray

    def __len__(self) -> int:
        return len(self.paths)

    def lengths(self) -> FloatArray:
        """How long each is, metres, shape (N,)."""
        steps = np.linalg.norm(np.diff(self.paths, axis=1), axis=2)
        return steps.sum(axis=1)

    def at(
        self, index: NDArray[np.intp], t: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Look up places along branches.

        Args:
            index: Which branch, shape (M,).
            t: How far along it, 0 at the foot to 1 at the tip, shape (M,).

        Returns:
            Places (M, 3), unit tangents (M, 3) and radii (M,).
        """
        last = self.paths.shape[1] - 2
        knot = np.clip((t * (last + 1)).astype(np.intp), 0, last)
        share = t * (last + 1) - knot
        first, second = self.paths[index, knot], self.paths[index, knot + 1]
        along = second - first
        thin, thick = self.radii[index, knot + 1], self.radii[index, knot]
        return first + share[:, None] * along, unit(along), thick + share * (thin - thick)

    def scaled(self, factors: ArrayLike) -> Branches:
        """Stretch along x, y and z by `factors` (3,), thickness aside; roots stay in place."""
        factor = np.where(self.paths < (-np.inf, -np.inf, 0.0), 1.0, np.asarray(factors))
        return Branches(self.paths * factor, self.radii)


def unit(vectors: FloatArray) -> FloatArray:
    """Vectors (..., 3) made one long."""
    scaled: FloatArray = vectors / np.maximum(
        np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12
    )
    return scaled


def tilted(rng: np.random.Generator, axes: FloatArray, angles: ArrayLike) -> FloatArray:
    """Directions (N, 3) that stand off unit `axes` (N, 3) by `angles` (N,) degrees, anyhow."""
    sideways = np.cross(axes, rng.standard_normal(axes.shape))
    angle = np.broadcast_to(np.radians(angles), len(axes))[:, None]
    return np.cos(angle) * axes + np.sin(angle) * unit(sideways)


def allotted(rng: np.random.Generator, shares: FloatArray, number: int) -> NDArray[np.intp]:
    """Draw `number` indices by `shares` (N,) of any sum, in order; as even as chance allows."""
    cumulated = np.cumsum(shares)
    marks = (np.arange(number) + rng.uniform(0, 1, number)) * (cumulated[-1] / number)
    return np.minimum(np.searchsorted(cumulated, marks), len(shares) - 1)


def tapering(base: FloatArray, knots: int, tip: float = 0.3) -> FloatArray:
    """Radii (N, K) that fall from `base` (N,), metres, to a share `tip` of it."""
    return np.maximum(base[:, None] * np.linspace(1, tip, knots), THINNEST)


def reaching(
    feet: FloatArray, bends: FloatArray, tips: FloatArray, radii: FloatArray, knots: int
) -> Branches:
    """Branches from `feet` to `tips` that set out towards `bends`: parabolas.

    Args:
        feet: Where they begin, metres, shape (N, 3).
        bends: Where they set out to, metres, shape (N, 3).
        tips: Where they end, metres, shape (N, 3).
        radii: Half the thickness at their feet, metres, shape (N,).
        knots: K.
    """
    t = np.linspace(0, 1, knots)[:, None]
    paths = (1 - t) ** 2 * feet[:, None] + 2 * t * (1 - t) * bends[:, None] + t**2 * tips[:, None]
    return Branches(paths, tapering(radii, knots))


def growing(
    rng: np.random.Generator,
    feet: FloatArray,
    headings: FloatArray,
    lengths: FloatArray,
    radii: FloatArray,
    *,
    knots: int,
    rise: float = 0.0,
    wiggle: float = 0.1,
) -> Branches:
    """Branches that grow step by step and turn a little at each.

    Args:
        rng: Source of randomness.
        feet: Where they begin, metres, shape (N, 3).
        headings: Unit vectors along which they set out, shape (N, 3).
        lengths: Metres, shape (N,).
        radii: Half the thickness at their feet, metres, shape (N,).
        knots: K.
        rise: How much they turn upwards in all; below 0 they hang.
        wiggle: How much they turn anyhow, at each step.
    """
    steps = (lengths / (knots - 1))[:, None]
    path, heading = [feet], headings
    for _ in range(knots - 1):
        path.append(path[-1] + steps * heading)
        turn = wiggle * rng.standard_normal(heading.shape)
        heading = unit(heading + turn + rise / (knots - 1) * UP)
    return Branches(np.stack(path, axis=1), tapering(radii, knots))


def sprouting(
    rng: np.random.Generator,
    parents: Branches,
    number: int,
    *,
    start: float,
    angle: tuple[float, float],
    length: float | tuple[float, float],
    thickness: float = 0.5,
    knots: int = 3,
    rise: float = 0.0,
    wiggle: float = 0.12,
) -> Branches:
    """Branches on branches.

    Args:
        rng: Source of randomness.
        parents: What they grow on; long ones bear more.
        number: How many grow.
        start: They leave their parents from this share of the length on.
        angle: Mean and standard deviation of the angle to the parent, degrees.
        length: Their length over the parent's, shorter towards its tip, or least and greatest
            length in metres.
        thickness: Their thickness over the parent's where they leave it.
        knots: K.
        rise: How much they turn upwards in all.
        wiggle: How much they turn anyhow, at each step.
    """
    reach = parents.lengths()
    share = reach + 0.25 * reach.mean()  # or else the tops of conifers would be bare
    index = allotted(rng, share, number)
    t = rng.uniform(start, 1, number)
    feet, axes, radii = parents.at(index, t)
    headings = tilted(rng, axes, rng.normal(*angle, number))
    if isinstance(length, tuple):
        lengths = rng.uniform(*length, number)
    else:
        lengths = length * reach[index] * (1.2 - 0.7 * t) * rng.uniform(0.6, 1.3, number)
    radii = np.minimum(thickness * radii, 0.03 * lengths + THINNEST)
    return growing(rng, feet, headings, lengths, radii, knots=knots, rise=rise, wiggle=wiggle)


def fitting(branches: Branches, half: float, height: float) -> FloatArray:
    """Factors (3,) along x, y and z that bring `branches` to half a width and a height, metres.

    Twigs grow beyond what their limbs reach, by how much depends on their angles. The height is
    that of the highest, the width leaves the farthest one in thirty out.
    """
    ends = branches.paths[:, -1]
    wide = np.quantile(np.hypot(ends[:, 0], ends[:, 1]), 0.97)
    across = np.clip(half / max(wide, 1e-6), 0.3, 2.0)
    return np.array([across, across, np.clip(height / max(ends[:, 2].max(), 1e-6), 0.5, 1.5)])


def rods(branches: Branches, sides: int) -> Mesh:
    """Branches as round rods with `sides` corners."""
    return tubes(branches.paths, branches.radii, sides)


def blades(rng: np.random.Generator, branches: Branches) -> Mesh:
    """Twigs as two crossed triangles a piece: about as wide from everywhere as a rod would be."""
    start, end = branches.paths[:, :-1].reshape(-1, 3), branches.paths[:, 1:].reshape(-1, 3)
    # A triangle's mean width is half its base, and a blade seen from all sides is 2 / pi of it.
    half = 2.2 * branches.radii[:, :-1].reshape(-1, 1)
    axis = unit(end - start)
    u = unit(np.cross(axis, rng.standard_normal(axis.shape)))
    v = np.cross(axis, u)
    corners = [start - half * u, start + half * u, end, start - half * v, start + half * v, end]
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    return Mesh.of(vertices, np.arange(len(vertices)).reshape(-1, 3))
