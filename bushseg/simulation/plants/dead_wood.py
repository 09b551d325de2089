"""Dead wood: snags, logs, stumps and heaps of brush."""

from collections.abc import Callable

import numpy as np

from bushseg.simulation.materials import DEAD_WOOD
from bushseg.simulation.mesh import Mesh, Surface, join
from bushseg.simulation.plants.branches import (
    UP,
    Branches,
    blades,
    growing,
    rods,
    sprouting,
    tapering,
    tilted,
)
from bushseg.simulation.plants.config import DeadWood, PlantsConfig
from bushseg.simulation.plants.distributions import choose
from bushseg.simulation.plants.plant import Plant


def grow_dead_wood(
    rng: np.random.Generator, config: PlantsConfig, kind: DeadWood | None = None
) -> Plant:
    """Make a piece of dead wood.

    Snags, logs and stumps are stems, class "tree"; heaps of brush are class "bush": cut branches
    that lie as dense as a bush stands, and that whoever clears bushes would clear as well.

    Args:
        rng: Source of randomness.
        config: How common each kind is.
        kind: What it is; None draws a kind.
    """
    name = choose(rng, config.dead_wood) if kind is None else kind
    material = DEAD_WOOD[rng.integers(len(DEAD_WOOD))]
    return Plant.of([Surface(KINDS[name](rng), material)], "bush" if name == "heap" else "tree")


def _snag(rng: np.random.Generator) -> Mesh:
    """A standing stem of 2 to 10 m, broken off, with what is left of its boughs."""
    height, thick = rng.uniform(2, 10), rng.uniform(0.08, 0.22)
    heading = tilted(rng, UP[None], rng.uniform(0, 8))
    stem = growing(
        rng,
        np.array([[0, 0, -0.25]]),
        heading,
        np.array([height + 0.25]),
        np.array([thick]),
        knots=9,
        wiggle=0.03,
    )
    stem = Branches(stem.paths, tapering(np.array([thick]), 9, tip=0.6))
    stubs = sprouting(
        rng, stem, int(rng.integers(4, 16)), start=0.3, angle=(70, 15), length=(0.2, 1.6)
    )
    twigs = sprouting(rng, stubs, 20, start=0.3, angle=(45, 15), length=(0.1, 0.5), knots=2)
    return join([rods(stem, 9), rods(stubs, 4), blades(rng, twigs)])


def _log(rng: np.random.Generator) -> Mesh:
    """A lying stem of 2 to 9 m along x, with stubs of boughs."""
    length, thick = rng.uniform(2, 9), rng.uniform(0.07, 0.3)
    knots = 8
    x = np.linspace(-0.5, 0.5, knots) * length
    bend = np.sin(np.linspace(0, np.pi, knots)) * rng.normal(0, 0.03 * length)
    radii = tapering(np.array([thick]), knots, tip=rng.uniform(0.5, 0.9))
    stem = Branches(np.stack([x, bend, 0.85 * radii[0]], axis=1)[None], radii)
    stubs = sprouting(
        rng, stem, int(rng.integers(2, 12)), start=0.3, angle=(60, 15), length=(0.1, 1.0), rise=0.5
    )
    return join([rods(stem, 9), rods(stubs, 4)])


def _stump(rng: np.random.Generator) -> Mesh:
    """What is left of a felled tree: 0.2 to 0.7 m, with roots."""
    height, thick = rng.uniform(0.2, 0.7), rng.uniform(0.12, 0.35)
    z = np.array([-0.2, 0.0, 0.5 * height, height])
    radii = thick * np.array([[1.6, 1.45, 1.08, 1.0]])
    stem = Branches(np.stack([0 * z, 0 * z, z], axis=1)[None], radii)
    around = np.linspace(0, 2 * np.pi, 5, endpoint=False) + rng.normal(0, 0.2, 5)
    out = np.stack([np.cos(around), np.sin(around), np.full(5, -0.25)], axis=1)
    feet = thick * out * (0.9, 0.9, 0) + 0.12 * UP
    roots = growing(rng, feet, out, np.full(5, 2.2 * thick), np.full(5, 0.35 * thick), knots=3)
    return join([rods(stem, 12), rods(roots, 6)])


def _heap(rng: np.random.Generator) -> Mesh:
    """Cut branches in a heap of 0.5 to 1.8 m."""
    height = rng.uniform(0.5, 1.8)
    radius = height * rng.uniform(0.8, 1.6)
    number = int(90 * radius)
    middles = rng.normal(0, 0.4 * radius, (number, 3))
    out = np.minimum(np.hypot(middles[:, 0], middles[:, 1]) / radius, 1)
    middles[:, 2] = height * (1 - out**2) * rng.uniform(0.05, 0.95, number) + 0.05
    headings = tilted(rng, np.tile(UP, (number, 1)), rng.normal(85, 14, number))
    lengths = rng.uniform(0.6, 1.5, number) * radius
    feet = middles - 0.5 * lengths[:, None] * headings
    sticks = growing(
        rng, feet, headings, lengths, rng.uniform(0.006, 0.03, number), knots=3, wiggle=0.1
    )
    twigs = sprouting(rng, sticks, 8 * number, start=0.2, angle=(40, 15), length=(0.1, 0.5))
    sticks, twigs = (
        Branches(np.maximum(part.paths, (-np.inf, -np.inf, 0.02)), part.radii)
        for part in (sticks, twigs)
    )
    return join([rods(sticks, 4), blades(rng, twigs)])


KINDS: dict[DeadWood, Callable[[np.random.Generator], Mesh]] = {
    "snag": _snag,
    "log": _log,
    "stump": _stump,
    "heap": _heap,
}
"""How each kind is made."""
