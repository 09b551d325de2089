"""Herbs with leaves: nettles, ferns, docks, umbellifers and what covers the ground."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from bushseg.points import FloatArray
from bushseg.simulation.materials import HERB_LEAF
from bushseg.simulation.mesh import Mesh, Model, Surface, instances, join
from bushseg.simulation.plants.branches import (
    UP,
    Branches,
    blades,
    growing,
    sprouting,
    tapering,
    tilted,
)
from bushseg.simulation.plants.config import HerbKind, PlantsConfig
from bushseg.simulation.plants.distributions import Spread, draw
from bushseg.simulation.plants.grass import Ground
from bushseg.simulation.plants.leaves import LeafKind, leaves
from bushseg.simulation.plants.scatter import assigned, patches

VARIANTS = 4
"""Plants grown of each kind; all others are those, turned and stretched."""


def grow_herbs(
    rng: np.random.Generator,
    config: PlantsConfig,
    terrain: Ground,
    xy: FloatArray,
    kind: HerbKind | None = None,
) -> Model:
    """Grow an herb at each place: class "low vegetation".

    Args:
        rng: Source of randomness.
        config: Kinds and heights.
        terrain: The ground.
        xy: Where they stand, metres, shape (N, 2).
        kind: The kind everywhere; None divides the area among all, in patches.

    Returns:
        One surface a kind.
    """
    if not len(xy):
        return []
    weights = config.herb_kinds if kind is None else {kind: 1.0}
    kinds = assigned(rng, xy, list(weights.values()), config.patch_size)
    lush = np.exp(0.25 * patches(rng, xy, config.patch_size / 2))
    root = np.column_stack([xy, terrain.height(xy)])
    model: Model = []
    for number, name in enumerate(weights):
        chosen = kinds == number
        if chosen.any():
            mesh = _stand(rng, name, root[chosen], draw(rng, _heights(config)[name]) * lush[chosen])
            model.append(Surface(mesh, HERB_LEAF[rng.integers(len(HERB_LEAF))]))
    return model


def _heights(config: PlantsConfig) -> dict[HerbKind, Spread]:
    """Heights by kind."""
    return {
        "nettle": config.nettle_height,
        "fern": config.fern_height,
        "dock": config.dock_height,
        "umbel": config.umbel_height,
        "cover": config.cover_height,
    }


def _stand(
    rng: np.random.Generator, kind: HerbKind, roots: FloatArray, heights: FloatArray
) -> Mesh:
    """Herbs of one kind at `roots` (N, 3) with `heights` (N,), metres."""
    typical = float(np.median(heights))
    variants = [KINDS[kind](rng, typical) for _ in range(VARIANTS)]
    which = rng.integers(VARIANTS, size=len(roots))
    parts = []
    for number, variant in enumerate(variants):
        chosen = which == number
        if not chosen.any():
            continue
        count = int(chosen.sum())
        high = heights[chosen] / typical * rng.uniform(0.75, 1.2, count)
        wide = high**0.5
        angles = np.column_stack(
            [rng.uniform(0, 2 * np.pi, count), rng.normal(0, 0.08, (count, 2))]
        )
        turns = Rotation.from_euler("ZYX", angles).as_matrix()
        parts.append(instances(variant, roots[chosen], turns, np.stack([wide, wide, high], axis=1)))
    return join(parts)


def _nettle(rng: np.random.Generator, height: float) -> Mesh:
    """A clump of upright stems with leaves all along."""
    number = int(rng.integers(3, 7))
    feet = np.column_stack([rng.normal(0, 0.08, (number, 2)), np.zeros(number)])
    headings = tilted(rng, np.tile(UP, (number, 1)), rng.uniform(0, 15, number))
    tall = height * rng.uniform(0.7, 1.0, number)
    stems = growing(rng, feet, headings, tall, np.full(number, 0.003), knots=3, wiggle=0.04)
    count = int(number * np.clip(14 * height, 6, 16))
    places, axes, _ = stems.at(rng.integers(number, size=count), rng.uniform(0.2, 1, count))
    out = tilted(rng, axes, 80)
    kind = LeafKind(float(np.clip(0.13 * height, 0.05, 0.12)), 0.6, "planophile")
    return join([blades(rng, stems), leaves(rng, places, 2 * out, kind)])


def _frond(rng: np.random.Generator, height: float) -> Mesh:
    """A rosette of fronds that rise and arch over, each with leaflets to both sides."""
    number = int(rng.integers(5, 9))
    feet = np.column_stack([rng.normal(0, 0.03, (number, 2)), np.zeros(number)])
    headings = tilted(rng, np.tile(UP, (number, 1)), rng.uniform(15, 45, number))
    stalks = growing(
        rng,
        feet,
        headings,
        np.full(number, 1.35 * height),
        np.full(number, 0.003),
        knots=5,
        rise=-1.1,
        wiggle=0.06,
    )
    pairs = 9
    t = np.tile(np.linspace(0.25, 0.98, pairs), number)
    places, axes, _ = stalks.at(np.arange(number).repeat(pairs), t)
    sideways = np.cross(axes, UP)
    sideways /= np.maximum(np.linalg.norm(sideways, axis=1, keepdims=True), 1e-6)
    length = (0.3 * height * np.sin(np.pi * np.clip(1.15 - t, 0.05, 1)))[:, None] + 0.01
    half = 0.035 * height * axes
    leaflets = [
        np.stack([places - half, places + half, places + side * length * sideways], axis=1)
        for side in (-1, 1)
    ]
    vertices = np.concatenate(leaflets).reshape(-1, 3)
    mesh = Mesh.of(vertices, np.arange(len(vertices)).reshape(-1, 3))
    return join([mesh, blades(rng, stalks)])


def _dock(rng: np.random.Generator, height: float) -> Mesh:
    """Large leaves from the ground, all ways."""
    number = int(rng.integers(6, 12))
    feet = np.column_stack([rng.normal(0, 0.02, (number, 2)), np.zeros(number)])
    headings = tilted(rng, np.tile(UP, (number, 1)), rng.uniform(10, 60, number))
    stalks = growing(
        rng,
        feet,
        headings,
        height * rng.uniform(0.6, 1.1, number),
        np.full(number, 0.004),
        knots=3,
        rise=-0.7,
    )
    middle, axes, _ = stalks.at(np.arange(number), np.full(number, 0.4))
    end = stalks.paths[:, -1]
    across = np.cross(axes, tilted(rng, axes, 90))
    across *= 0.2 * height * rng.uniform(0.6, 1.1, (number, 1))
    wide = (middle + end) / 2
    vertices = np.stack([middle, wide - across, end, middle, end, wide + across], axis=1)
    mesh = Mesh.of(vertices.reshape(-1, 3), np.arange(6 * number).reshape(-1, 3))
    return join([mesh, blades(rng, stalks)])


def _umbel(rng: np.random.Generator, height: float) -> Mesh:
    """A stem that forks and carries flat heads of flowers, leaves at the foot."""
    paths = np.linspace(0, 1, 4)[:, None] * (rng.normal(0, 0.05, 3) * (1, 1, 0) + UP) * 0.8 * height
    stem = Branches(paths[None], tapering(np.full(1, 0.004), 4))
    forks = sprouting(
        rng, stem, 5, start=0.5, angle=(35, 8), length=(0.2 * height, 0.35 * height), rise=0.5
    )
    tops = np.concatenate([forks.paths[:, -1], paths[-1:]])
    places = tops.repeat(5, axis=0)
    places = places + rng.normal(0, 1, places.shape) * (0.04, 0.04, 0.006)
    flowers = leaves(rng, places, places - places.mean(axis=0), LeafKind(0.05, 0.9, "planophile"))
    foot = np.tile(0.1 * height * UP, (8, 1))
    out = tilted(rng, np.tile(UP, (8, 1)), 60)
    low = leaves(rng, foot, 3 * out, LeafKind(0.3 * height, 0.5, "plagiophile"))
    return join([blades(rng, stem), blades(rng, forks), flowers, low])


def _cover(rng: np.random.Generator, height: float, *, across: float = 0.16) -> Mesh:
    """A low cushion of small leaves."""
    number = 28
    places = np.column_stack(
        [rng.normal(0, across, (number, 2)), height * rng.uniform(0.1, 1, number) ** 0.7]
    )
    out = places * (1, 1, 0) + rng.normal(0, 0.1, places.shape)
    return leaves(rng, places, out, LeafKind(0.07, 0.8, "planophile"))


KINDS: dict[HerbKind, Callable[[np.random.Generator, float], Mesh]] = {
    "nettle": _nettle,
    "fern": _frond,
    "dock": _dock,
    "umbel": _umbel,
    "cover": _cover,
}
"""How an herb of about a height (metres) is made, by kind."""
