"""Hedges: clipped to flat faces, or a row of shrubs that nobody cuts."""

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import HEDGE_LEAF, SHRUB_BARK
from bushseg.simulation.mesh import Model, Surface, join, placed
from bushseg.simulation.plants.branches import UP, Branches, blades, reaching, rods, sprouting
from bushseg.simulation.plants.config import PlantsConfig
from bushseg.simulation.plants.crowns import leaf_material
from bushseg.simulation.plants.distributions import choose, draw
from bushseg.simulation.plants.leaves import LeafKind, leaves, number_and_scale
from bushseg.simulation.plants.plant import Plant
from bushseg.simulation.plants.scatter import patches
from bushseg.simulation.plants.shrubs import grow_shrub

SHELL = 0.12
"""Most leaves of a clipped hedge lie within about this much of its faces, metres."""

LEAVES_PER_AREA = 900
"""Most leaves of a clipped hedge on a square metre of its faces, times detail."""


def grow_hedge(
    rng: np.random.Generator, config: PlantsConfig, length: float, height: float | None = None
) -> Plant:
    """Grow a hedge along x: class "bush".

    Args:
        rng: Source of randomness.
        config: Distributions of all that isn't given.
        length: Metres.
        height: Metres; None draws a height.
    """
    clipped = rng.random() < config.hedge_clipped
    if height is None:
        height = draw(rng, config.hedge_height if clipped else config.hedgerow_height)
    build = _clipped if clipped else _overgrown
    return Plant.of(build(rng, config, length, height), "bush")


def _overgrown(
    rng: np.random.Generator, config: PlantsConfig, length: float, height: float
) -> Model:
    """A row of shrubs that grow into each other, of a few kinds, with some gaps."""
    at, model = 0.0, Model()
    # Shrubs of a hedge hide each other: fewer leaves and twigs do.
    coarse = config.model_copy(update={"detail": 0.6 * config.detail})
    while at < length:
        tall = height * rng.uniform(0.65, 1.15)
        shrub = grow_shrub(rng, coarse, height=tall)
        where = (at - length / 2, rng.normal(0, 0.12 * height), 0.0)
        model += placed(shrub.model, where, rng.uniform(0, 2 * np.pi))
        at += max(shrub.radius, 0.35) * rng.uniform(0.6, 1.3)
    return _merged(model)


def _merged(model: Model) -> Model:
    """The same with one surface a material: a scene holds each as a geometry."""
    materials = dict.fromkeys(material for _, material in model)
    return [
        Surface(join([mesh for mesh, of in model if of == material]), material)
        for material in materials
    ]


def _clipped(rng: np.random.Generator, config: PlantsConfig, length: float, height: float) -> Model:
    """Leaves near the faces of a block, on twigs of upright stems."""
    depth = min(draw(rng, config.hedge_depth), 1.3 * height)
    sides = np.array([length / 2, depth / 2])
    kind = LeafKind(
        min(draw(rng, config.shrub_leaf_length), 0.06),
        draw(rng, config.leaf_aspect),
        choose(rng, config.leaf_angles),
    )
    faces = 2 * height * (length + depth) + length * depth
    area = draw(rng, config.hedge_leaf_density) * faces * 2 * SHELL
    bare = rng.random() < config.shrub_leafless
    budget = LEAVES_PER_AREA * config.detail * faces
    number, scale = number_and_scale(area * (0.3 if bare else 1.0), kind, budget)
    places, outward = _shell(rng, number, sides, height)
    places, outward = _thinned(rng, places, outward)
    wood = _hedge_wood(rng, config, sides, height)
    return [
        Surface(leaves(rng, places, outward, kind, scale), leaf_material(rng, config, HEDGE_LEAF)),
        Surface(
            join([rods(wood[0], 5), rods(wood[1], 3), blades(rng, wood[2])]),
            SHRUB_BARK[rng.integers(len(SHRUB_BARK))],
        ),
    ]


def _shell(
    rng: np.random.Generator, number: int, sides: FloatArray, height: float
) -> tuple[FloatArray, FloatArray]:
    """Draw places under the faces of a block, and the directions out of it; (N, 3) each.

    The faces swell and sink by a few centimetres, as a clipper leaves them.
    """
    x, y = sides
    areas = np.array([2 * y * height, 2 * y * height, 2 * x * height, 2 * x * height, 4 * x * y])
    face = rng.choice(5, number, p=areas / areas.sum())
    normals = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)], float)[face]
    places = rng.uniform(-1, 1, (number, 3)) * (x, y, 0.5 * height) + (0, 0, 0.5 * height)
    on = np.where(normals == 0, places, normals * (x, y, height))
    swell = 0.03 * patches(rng, on[:, :2] + on[:, 2:], 0.8)
    sunk = np.abs(rng.exponential(SHELL * 0.7, number)) - swell
    batter = 1 - 0.12 * np.clip(on[:, 2:] / height, 0, 1) * (0, 1, 0)  # narrower at the top
    inner = np.minimum(sunk, 0.9 * min(x, y, height))[:, None]
    inside = on * batter - inner * normals
    inside[:, 2] = np.maximum(inside[:, 2], 0.02)
    return inside, normals


def _thinned(
    rng: np.random.Generator, places: FloatArray, outward: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Take leaves where a hedge is thin or dying, and low down, where it is dark."""
    thin = patches(rng, places[:, :2] + (0.0, 0.7) * places[:, 2:], 1.5) > 1.4
    low = rng.uniform(0, 0.3, len(places)) > places[:, 2] + 0.1
    kept = ~((thin | low) & (rng.random(len(places)) < 0.7))
    return places[kept], outward[kept]


def _hedge_wood(
    rng: np.random.Generator, config: PlantsConfig, sides: FloatArray, height: float
) -> tuple[Branches, Branches, Branches]:
    """Stems a third of a metre apart, branches and twigs, all within the faces."""
    x, y = sides
    number = max(int(6 * x), 2)
    feet = np.zeros((number, 3))
    feet[:, 0] = np.linspace(-0.97, 0.97, number) * x + rng.normal(0, 0.05, number)
    feet[:, 1] = rng.normal(0, 0.15 * y, number)
    feet[:, 2] = -0.1
    tips = feet + np.column_stack(
        [rng.normal(0, 0.1, number), rng.normal(0, 0.3 * y, number), np.full(number, 0.9 * height)]
    )
    bends = (feet + tips) / 2 + 0.1 * height * UP
    stems = reaching(feet, bends, tips, rng.uniform(0.006, 0.02, number), 5)
    branches = sprouting(
        rng, stems, 9 * number, start=0.1, angle=(60, 15), length=(0.3 * y, 0.9 * y), rise=0.4
    )
    twigs = sprouting(
        rng,
        branches,
        int(min(40 * number * config.detail, 20_000)),
        start=0.3,
        angle=(45, 15),
        length=(0.06, 0.2),
        knots=2,
    )
    clipped = (_clip(rng, part, sides, height) for part in (stems, branches, twigs))
    stems, branches, twigs = clipped
    return stems, branches, twigs


def _clip(
    rng: np.random.Generator, branches: Branches, sides: FloatArray, height: float
) -> Branches:
    """Push what sticks out back to the faces, give or take a few millimetres."""
    low, high = [*-sides, -np.inf], [*sides, height]
    paths = np.clip(branches.paths, low, high)
    # The shake keeps knots apart that were pushed into one corner.
    return Branches(paths + rng.normal(0, 0.003, paths.shape), branches.radii)
