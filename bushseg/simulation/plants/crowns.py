"""What fills a crown: twigs and leaves, within a budget, and of what material."""

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import DEAD_LEAF, Material
from bushseg.simulation.mesh import Mesh
from bushseg.simulation.plants.branches import Branches, allotted
from bushseg.simulation.plants.config import PlantsConfig
from bushseg.simulation.plants.leaves import LeafKind, leaves, number_and_scale
from bushseg.simulation.plants.scatter import patches

GROUND_CLEARANCE = 0.02
"""No leaf grows from below this height, metres."""


def foliage(
    rng: np.random.Generator,
    twigs: Branches,
    kind: LeafKind,
    *,
    area: float,
    most: float,
    start: float = 0.1,
    spread: float = 0.0,
    lowest: float = GROUND_CLEARANCE,
    unevenness: float = 0.0,
) -> Mesh:
    """Clothe twigs in leaves.

    Args:
        rng: Source of randomness.
        twigs: What bears the leaves, evenly along it.
        kind: The leaves.
        area: One-sided leaf area, square metres.
        most: The most leaves there may be.
        start: Leaves grow from this share of a twig on.
        spread: Standard deviation of places off the twig, for shoots too small to be drawn,
            metres.
        lowest: Leaves don't grow below this height, metres.
        unevenness: Standard deviation of the logarithm of how leafy parts of the crown are.
    """
    number, scale = number_and_scale(area, kind, most)
    middles = twigs.paths.mean(axis=1)
    size = max(0.3 * float(np.ptp(middles, axis=0).max()), 0.1)
    # The third dimension is folded into two: what matters is that neighbors are alike.
    folded = middles[:, :2] + (0.8, -0.6) * middles[:, 2:]
    share = twigs.lengths() * np.exp(unevenness * patches(rng, folded, size))
    index = allotted(rng, share, number)
    places, headings, _ = twigs.at(index, rng.uniform(start, 1.0, number))
    places = places + spread * rng.standard_normal(places.shape)
    kept = places[:, 2] > lowest
    mesh = leaves(rng, places[kept], headings[kept], kind, scale)
    np.maximum(mesh.vertices[:, 2], 0.0, out=mesh.vertices[:, 2])
    return mesh


def leaf_material(
    rng: np.random.Generator, config: PlantsConfig, materials: tuple[Material, ...]
) -> Material:
    """Draw what leaves are made of; some plants keep their dead ones."""
    kinds = DEAD_LEAF if rng.random() < config.dead_leaves else materials
    return kinds[rng.integers(len(kinds))]


def volume(profile: FloatArray, radius: float, height: float) -> float:
    """A crown's volume, cubic metres.

    Args:
        profile: Its radius over the greatest at evenly spaced heights, shape (P,).
        radius: The greatest radius, metres.
        height: From its base to its top, metres.
    """
    return float(np.pi * radius**2 * height * np.mean(profile**2))


def within(
    rng: np.random.Generator,
    profile: FloatArray,
    number: int,
    *,
    filling: float,
    power: float = 2.0,
) -> FloatArray:
    """Draw places in a crown of radius and height 1.

    Args:
        rng: Source of randomness.
        profile: The crown's radius over the greatest at evenly spaced heights, shape (P,).
        number: N.
        filling: 2 fills it evenly; less leaves the middle empty.
        power: Heights are as common as this power of the radius there: 2 fills the volume evenly,
            1 puts as many places around a cone's tip as there is room for on its mantle.

    Returns:
        Places, shape (N, 3); x and y in -1..1 and z in 0..1.
    """
    heights = np.linspace(0, 1, 101)
    radii = np.interp(heights, np.linspace(0, 1, len(profile)), profile)
    cumulated = np.cumsum(radii**power + 1e-6)
    # Even steps with a shake: tips that keep clear of each other leave no holes by chance.
    shares = rng.permutation((np.arange(number) + rng.uniform(0, 1, number)) / number)
    z = np.interp(shares * cumulated[-1], cumulated, heights)
    around = rng.uniform(0, 2 * np.pi, number)
    out = np.interp(z, heights, radii) * rng.uniform(0, 1, number) ** (filling / 4)
    lobes = rng.normal(0, (0.12, 0.1, 0.08))[:, None]
    phases = rng.uniform(0, 2 * np.pi, (3, 1))
    out *= 1 + (lobes * np.sin(np.arange(1, 4)[:, None] * around + phases + 2 * z)).sum(axis=0)
    return np.stack([out * np.cos(around), out * np.sin(around), z], axis=1)
