"""Spreading over a site what its place's densities ask for, as it stands in nature."""

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.materials import WATER
from bushseg.simulation.mesh import placed
from bushseg.simulation.places.builder import CANDIDATES, Builder
from bushseg.simulation.places.ground import BUILT, WAY
from bushseg.simulation.plants import grow_grass, grow_herbs
from bushseg.simulation.plants.config import GrassStand
from bushseg.simulation.structures.earth import rock
from bushseg.simulation.structures.furniture import FURNITURE
from bushseg.simulation.structures.people import person
from bushseg.simulation.structures.poles import lamp_post, marker, sign
from bushseg.simulation.terrain import waves

LARGEST_MEADOW = 160_000
"""A site has at most so many tufts of grass; sparser ones will do for a large site."""


def furnish(b: Builder) -> None:
    """Spread all that a layout left to chance, the large before the small."""
    _puddles(b)
    _things(b)
    _trees(b)
    _rocks(b)
    _shrubs(b)


def _puddles(b: Builder) -> None:
    """Fill hollows with water, half of them on the way."""
    for _ in range(b.count("puddles")):
        on_way = b.rng.random() < 0.5
        where = b.path[b.rng.integers(len(b.path), size=20)] if on_way else b.anywhere(20)
        room = b.ground.at(b.ground.clearance(BUILT), where)
        radii = b.rng.lognormal(-0.2, 0.5) * b.rng.uniform(0.5, 1.0, 2)
        b.ground.puddle(where[room.argmax()], radii, b.yaw(), WATER)


def _things(b: Builder) -> None:
    """Stand vehicles, furniture, poles and people about."""
    for _ in range(b.count("vehicles")):
        b.stand(b.vehicle("tractor" if b.rng.random() < 0.2 else None), "vehicle or person", 2.2)
    names = list(FURNITURE)
    for _ in range(b.count("furniture")):
        b.stand(FURNITURE[names[b.rng.integers(len(names))]](b.rng), "man-made", 1.1)
    for _ in range(b.count("poles")):
        make = (lamp_post, sign, marker)[b.rng.integers(3)]
        where = b.along(b.path, 2.2) if b.rng.random() < 0.6 else None
        b.stand(make(b.rng), "man-made", 0.3, where)
    for _ in range(b.count("people")):
        if b.rng.random() < 0.6:
            place = b.ground.claim(b.anywhere(), 0.4)
        else:
            place = b.ground.claim(b.along(b.path, 1.0), 0.4, least=BUILT)
        if place is not None:
            b.add(person(b.rng), "vehicle or person", place, b.yaw())


def _trees(b: Builder) -> None:
    """Plant trees where woods are, crowns touching; saplings in their gaps."""
    for _ in range(b.count("trees")):
        b.tree_among(_liked(b, b.woods))
    for _ in range(b.count("saplings")):
        b.shrub_among(_liked(b, b.scrub + 0.3 * b.woods), b.nursery.sapling())
    for _ in range(b.count("dead_wood")):
        b.shrub_among(_liked(b, b.woods), b.nursery.dead_wood())


def _rocks(b: Builder) -> None:
    """Strew rocks, most of them small."""
    for _ in range(b.count("rocks")):
        size = float(np.clip(b.rng.lognormal(-0.7, 0.6), 0.15, 2.5))
        place = b.ground.claim(b.anywhere(20), 0.5 * size + 0.3)
        if place is None:
            continue
        model = placed(rock(b.rng, size), b.ground.terrain.point(place), b.yaw())
        b.scene.add(model, "ground", instance=False)


def _shrubs(b: Builder) -> None:
    """Plant shrubs under trees, against what is built, in clumps and singly."""
    for x, y, radius in list(b.trunks):
        below = b.rng.poisson(b.amounts["undergrowth"] * b.rng.uniform(0, 2))
        for _ in range(below):
            plant = b.nursery.shrub() if b.rng.random() < 0.75 else b.nursery.sapling()
            around = np.array([x, y]) + b.rng.normal(0, 0.3 + 0.5 * radius, (12, 2))
            b.shrub_among(around, plant)
    left = b.count("shrubs")
    built = b.ground.clearance(BUILT).ravel()
    by_walls = b.ground.centers()[(built > 0.2) & (built < 1.3)]
    while left > 0:
        if b.rng.random() < b.amounts["clumping"]:
            middle = _liked(b, b.scrub)[0]
            number = min(int(b.rng.geometric(0.22)), left)
            spread = b.rng.uniform(0.4, 1.3) * np.sqrt(number)
            for _ in range(number):
                b.shrub_among(middle + b.rng.normal(0, spread, (12, 2)))
            left -= number
            continue
        where = _liked(b, b.scrub)
        if len(by_walls) and b.rng.random() < 0.4:
            where = by_walls[b.rng.integers(len(by_walls), size=20)]
        b.shrub_among(where)
        left -= 1


def _liked(b: Builder, liking: FloatArray) -> FloatArray:
    """Draw places by how much they are liked, a share a cell (C, C); (N, 2)."""
    places = b.anywhere(400)
    likes = b.ground.at(liking, places)
    keys = np.log(np.maximum(likes, 1e-9)) + b.rng.gumbel(size=len(places))
    return places[np.argsort(-keys)[:CANDIDATES]]


def grow_layer(b: Builder) -> None:
    """Grow grass and herbs wherever the ground is not taken by something else."""
    area = b.size**2
    number = min(round(b.amounts["grass"] * area), LARGEST_MEADOW)
    free = (b.ground.taken < BUILT) & ~b.bare
    plants = b.nursery.config
    layers: list[tuple[GrassStand | None, NDArray[np.bool_]]] = [
        ("lawn", free & b.mown),
        (None, free & ~b.mown),
    ]
    for stand, cells in layers:
        xy = _rooted(b, cells, round(number * cells.mean()))
        if len(xy):
            model = grow_grass(b.rng, plants, b.ground.terrain, xy, stand)
            b.scene.add(model, "low vegetation", instance=False)
    tall = free & ~b.mown & (b.ground.taken != WAY)
    xy = _rooted(b, tall, round(min(b.amounts["herbs"] * area, 0.2 * LARGEST_MEADOW) * tall.mean()))
    if len(xy):
        model = grow_herbs(b.rng, plants, b.ground.terrain, xy)
        b.scene.add(model, "low vegetation", instance=False)


def _rooted(b: Builder, cells: NDArray[np.bool_], number: int) -> FloatArray:
    """Draw places in some cells (C, C), denser in patches; (N, 2)."""
    index = np.flatnonzero(cells)
    if not len(index) or number < 1:
        return np.zeros((0, 2))
    middles = b.ground.centers()[index]
    liking = np.exp(0.8 * waves(b.rng, middles, shortest=1.5, longest=12))
    chosen = b.rng.choice(len(index), number, p=liking / liking.sum())
    return middles[chosen] + b.rng.uniform(-0.5, 0.5, (number, 2)) * b.ground.cell
