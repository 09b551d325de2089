"""Shrubs: several stems from the ground, in seven habits."""

from dataclasses import dataclass

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import SHRUB_BARK, SHRUB_LEAF
from bushseg.simulation.mesh import Model, Surface, join
from bushseg.simulation.plants.branches import (
    UP,
    Branches,
    blades,
    fitting,
    growing,
    reaching,
    rods,
    sprouting,
    unit,
)
from bushseg.simulation.plants.config import PlantsConfig, ShrubHabit
from bushseg.simulation.plants.crowns import foliage, leaf_material, volume, within
from bushseg.simulation.plants.distributions import choose, draw
from bushseg.simulation.plants.leaves import LeafKind
from bushseg.simulation.plants.plant import Plant


@dataclass(frozen=True, slots=True)
class Habit:
    """How a shrub is built.

    Attributes:
        width: Least and greatest width over height.
        stems: Least and greatest number of stems.
        feet: How far apart stems leave the ground, over the width.
        profile: Radius over the greatest at evenly spaced heights, from the ground up.
        lift: How steeply stems set out: the height they aim at over that of their tips; above 1
            they come down again.
        filling: How full the inside is: 2 as full as the rim, 1 rather hollow.
        bare: Least and greatest share of the height without leaves.
        density: Factor on the leaf area density.
        twigs: Factor on the number of twigs.
    """

    width: tuple[float, float]
    stems: tuple[int, int]
    feet: float
    profile: tuple[float, ...]
    lift: float
    filling: float = 1.5
    bare: tuple[float, float] = (0.0, 0.15)
    density: float = 1.0
    twigs: float = 1.0


HABITS: dict[ShrubHabit, Habit] = {
    "multi_stemmed": Habit(
        (0.65, 1.1), (5, 14), 0.1, (0.2, 0.45, 0.75, 1.0, 0.95, 0.5), 0.8, bare=(0.05, 0.3)
    ),
    "mounded": Habit((0.95, 1.7), (9, 18), 0.2, (0.85, 1.0, 0.97, 0.85, 0.62, 0.2), 0.7),
    "columnar": Habit((0.28, 0.5), (3, 9), 0.25, (0.55, 0.9, 1.0, 0.95, 0.75, 0.2), 0.6),
    "spreading": Habit((1.7, 3.2), (9, 18), 0.2, (0.8, 1.0, 0.95, 0.75, 0.4), 0.9, filling=2.0),
    "arching": Habit((1.1, 1.9), (8, 20), 0.12, (0.9, 1.0, 0.9, 0.75, 0.4), 1.9),
    "sparse": Habit(
        (0.6, 1.2), (3, 7), 0.12, (0.3, 0.7, 1.0, 1.0, 0.8, 0.3), 0.8, 2.0, (0.1, 0.4), 0.4, 0.5
    ),
    "dense": Habit(
        (0.7, 1.2), (8, 16), 0.2, (0.75, 0.97, 1.0, 0.97, 0.8, 0.35), 0.7, 1.2, (0, 0.08), 1.9, 1.3
    ),
}
"""Habits by name; widths and leaf densities come on top of what the settings say."""

TALLEST = 5.5
"""No shrub is drawn higher, metres: several stems and higher still is a tree."""

WINTER_LEAVES = 0.04
"""Leaf area that leafless shrubs keep, over what they would have."""


def grow_shrub(
    rng: np.random.Generator,
    config: PlantsConfig,
    habit: ShrubHabit | None = None,
    height: float | None = None,
) -> Plant:
    """Grow a shrub: class "bush".

    Args:
        rng: Source of randomness.
        config: Distributions of all that isn't given.
        habit: How it grows; None draws a habit.
        height: Metres; None draws a height.
    """
    build = HABITS[choose(rng, config.shrub_habits) if habit is None else habit]
    if height is None:
        height = min(draw(rng, config.shrub_height), TALLEST)
    # Tall shrubs are less wide for their height: they would be thickets, not plants.
    half = min(0.5 * height * rng.uniform(*build.width), 1.2 + 0.35 * height)
    bare = rng.random() < config.shrub_leafless
    wood = shrub_wood(rng, build, half, height, (2.2 if bare else 1.0) * config.detail)
    if rng.random() < config.shrub_shoots:
        wood = (*wood[:3], _with_shoots(rng, wood[1], wood[3], min(2 * half, height)))
    profile = np.array(build.profile)
    density = draw(rng, config.shrub_leaf_density) * build.density
    # Leaves keep to the light: the larger a shrub, the emptier it is inside.
    density *= min(height / 1.3, 4.0) ** -0.3
    area = density * volume(profile, half, height)
    kind = LeafKind(
        draw(rng, config.shrub_leaf_length),
        draw(rng, config.leaf_aspect),
        choose(rng, config.leaf_angles),
    )
    leaves = foliage(
        rng,
        wood[-1],
        kind,
        area=area * (WINTER_LEAVES if bare else 1.0),
        most=config.max_shrub_leaves * config.detail,
        spread=0.02 + 0.02 * half,
        lowest=max(height * rng.uniform(*build.bare), 0.02),
        unevenness=config.leaf_unevenness,
    )
    model: Model = [
        Surface(leaves, leaf_material(rng, config, SHRUB_LEAF)),
        Surface(
            join([*(rods(part, 5 - n) for n, part in enumerate(wood[:-1])), blades(rng, wood[-1])]),
            SHRUB_BARK[rng.integers(len(SHRUB_BARK))],
        ),
    ]
    return Plant.of(model, "bush")


def shrub_wood(
    rng: np.random.Generator, build: Habit, half: float, height: float, detail: float
) -> tuple[Branches, Branches, Branches, Branches]:
    """Grow stems, limbs, branches and twigs.

    Args:
        rng: Source of randomness.
        build: The shrub's habit.
        half: Half its width, metres.
        height: Its height, metres.
        detail: Factor on the number of branches and twigs.

    Returns:
        Stems from the ground, limbs on stems, branches on limbs, twigs on branches.
    """
    profile, extent = np.array(build.profile), np.array([half, half, height])
    num_stems = int(rng.integers(build.stems[0], build.stems[1] + 1))
    tips = within(rng, profile, num_stems, filling=build.filling)
    tips[:, 2] = 0.35 + 0.63 * tips[:, 2]  # stems end in the upper parts
    tips *= extent
    around = tips[:, :2] / np.maximum(np.hypot(*tips[:, :2].T), 1e-9)[:, None]
    feet = np.zeros_like(tips)
    feet[:, :2] = 2 * half * build.feet * around * rng.uniform(0, 1, (num_stems, 1)) ** 0.5
    feet[:, 2] = -0.05 - 0.05 * height  # the ground may slope
    bends = feet + (tips - feet) * (0.35, 0.35, build.lift)
    thick = (0.005 + 0.006 * height) * rng.uniform(0.6, 1.4, num_stems)
    stems = reaching(feet, bends, tips, thick, 6)

    num_limbs = int(num_stems * 2 + 14 + 6 * min(half * height, 4.0))
    limbs = _limbs(
        rng, stems, within(rng, profile, num_limbs, filling=build.filling, power=1.5) * extent
    )
    size = min(2 * half, height)
    branches = sprouting(
        rng,
        join_branches(stems, limbs),
        int(np.clip(170 * size**0.6 * build.twigs * np.sqrt(detail), 40, 320)),
        start=0.3,
        angle=(45, 15),
        length=(0.12 * size, 0.3 * size),
        rise=0.3,
    )
    twigs = sprouting(
        rng,
        branches,
        int(np.clip(650 * size**0.7 * build.twigs * detail, 60, 2500 * detail)),
        start=0.15,
        angle=(40, 15),
        length=(0.05 + 0.03 * size, 0.12 + 0.09 * size),
        knots=2,
    )
    factors = fitting(twigs, half, 0.97 * height)
    fitted = (part.scaled(factors) for part in (stems, limbs, branches, twigs))
    stems, limbs, branches, twigs = fitted
    return stems, limbs, branches, twigs


def _with_shoots(
    rng: np.random.Generator, limbs: Branches, twigs: Branches, size: float
) -> Branches:
    """Add shoots to the twigs that grow out of the crown, up to half its `size`, metres."""
    number = int(rng.integers(4, 25))
    feet, axes, radii = limbs.at(rng.integers(len(limbs), size=number), rng.uniform(0.7, 1, number))
    headings = unit(axes + rng.uniform(0.5, 2, (number, 1)) * UP)
    lengths = rng.uniform(0.2, 0.5, number) * size
    shoots = growing(rng, feet, headings, lengths, 0.6 * radii, knots=2)
    return Branches(
        np.concatenate([twigs.paths, shoots.paths]), np.concatenate([twigs.radii, shoots.radii])
    )


def _limbs(rng: np.random.Generator, stems: Branches, tips: FloatArray) -> Branches:
    """Limbs from the stems to `tips` (N, 3), metres, each from a stem that stands near."""
    ends = stems.paths[:, -1]
    distance = np.linalg.norm(tips[:, None] - ends[None], axis=2)
    index = (distance * rng.uniform(0.6, 1.4, distance.shape)).argmin(axis=1)
    share = np.clip(tips[:, 2] / np.maximum(ends[index, 2], 1e-6), 0.1, 1.2)
    feet, axes, radii = stems.at(index, share * rng.uniform(0.25, 0.75, len(tips)))
    reach = np.linalg.norm(tips - feet, axis=1, keepdims=True)
    return reaching(feet, feet + 0.4 * reach * axes, tips, 0.6 * radii, 5)


def join_branches(stems: Branches, limbs: Branches) -> Branches:
    """One set of two; stems give up every knot too many."""
    knots = limbs.paths.shape[1]
    kept = np.rint(np.linspace(0, stems.paths.shape[1] - 1, knots)).astype(np.intp)
    return Branches(
        np.concatenate([stems.paths[:, kept], limbs.paths]),
        np.concatenate([stems.radii[:, kept], limbs.radii]),
    )
