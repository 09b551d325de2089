"""What stands between a street and its houses, and the houses themselves."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import CONCRETE, GRAVEL
from bushseg.simulation.places.builder import Builder
from bushseg.simulation.places.ground import BUILT
from bushseg.simulation.places.lines import beside, length, stretch
from bushseg.simulation.plants.distributions import draw
from bushseg.simulation.structures.buildings import BuildingForm, building

FORMS: tuple[BuildingForm, ...] = ("gable", "gable", "gable", "flat", "block")


@dataclass(frozen=True, slots=True)
class Plot:
    """A house's piece of a street.

    Attributes:
        edge: Where the pavement ends, metres, shape (P, 2).
        wall: The house's front, from corner to corner, metres, shape (2, 2).
        out: Unit vector from the street to the house, (2,).
        depth: From the pavement to the house, metres.
    """

    edge: FloatArray
    wall: FloatArray
    out: FloatArray
    depth: float


def rows(b: Builder, middle: FloatArray, off: float) -> Iterator[Plot]:
    """Build houses along a street whose pavements end `off` metres from its middle."""
    left = b.count("buildings")
    terraced = b.rng.random() < b.structures.terraced
    for side in (-1, 1):
        line = beside(middle, side * off)
        depth = min(draw(b.rng, b.structures.front_garden), b.size / 10)
        at, total = b.rng.uniform(0, 6), length(line)
        while at < total - 5 and left > 0:
            house = building(b.rng, FORMS[b.rng.integers(len(FORMS))], largest=b.size / 3.5)
            own = max(depth + b.rng.normal(0, 0.1 if terraced else 0.8), 0.6)
            edge = stretch(line, at / total, min((at + house.length) / total, 1.0))
            along = edge[-1] - edge[0]
            along /= max(float(np.linalg.norm(along)), 1e-6)
            out = side * np.array([-along[1], along[0]])
            center = edge.mean(axis=0) + (own + house.width / 2) * out
            yaw = float(np.arctan2(along[1], along[0])) + (np.pi if side < 0 else 0.0)
            if b.erect(house, center, yaw):
                left -= 1
                half = house.length / 2 * along
                foot = center - house.width / 2 * out
                yield Plot(edge, np.stack([foot - half, foot + half]), out, own)
            gap = 0.05 if terraced and b.rng.random() < 0.8 else b.rng.uniform(1.5, 9.0)
            at += house.length + gap


def front(b: Builder, plot: Plot) -> None:
    """Plant and bound a front garden; where nothing grows it is paved."""
    green = b.has("front_plants") and b.rng.random() < b.amounts["front_plants"]
    rim = plot.edge + 0.35 * plot.out
    walled = b.fenced(b.structures.front_walls)
    if walled:
        kinds = ("wall", "concrete", "wall", "picket", "mesh", "boards")
        b.enclose(rim, kinds[b.rng.integers(len(kinds))], b.rng.uniform(0.4, 1.3))
    if green and plot.depth > 0.8:
        behind = plot.edge + (0.95 if walled else 0.6) * plot.out
        _rim_plants(b, stretch(behind, *_opening(b)))
    if b.has("front_plants") and b.rng.random() < b.amounts["front_plants"]:
        _by_wall(b, plot)
    if not green and plot.depth > 1 and b.has("buildings"):
        cells = b.ground.within(plot.edge + 0.5 * plot.depth * plot.out, 0.5 * plot.depth)
        cells &= b.ground.taken < BUILT
        b.ground.lay(cells, (GRAVEL, CONCRETE)[b.rng.integers(2)])
        b.bare |= cells
    if b.has("parked") and plot.depth > 5.2 and b.rng.random() < 0.4:
        place = (plot.edge[len(plot.edge) // 4] + 0.5 * (plot.depth + 0.5) * plot.out)[None]
        yaw = float(np.arctan2(plot.out[1], plot.out[0])) + np.pi * b.rng.integers(2)
        if b.ground.at(b.ground.clearance(BUILT), place)[0] > 1.1:
            b.stand(b.vehicle(), "vehicle or person", 1.1, place, yaw)


def back(b: Builder, plot: Plot) -> None:
    """A garden behind a house: hedges or fences along it, a shed, shrubs and small trees."""
    deep, house = b.rng.uniform(7, 16), b.rng.uniform(7, 10)
    start = plot.wall[0] + b.rng.uniform(0.5, 1.0) * house * plot.out
    rear = plot.wall + (house + deep) * plot.out
    inside = (0.8, b.size - 0.8)
    for line in (np.linspace(start, rear[0], 8), np.linspace(rear[0], rear[1], 10)):
        kept = line[((line > inside[0]) & (line < inside[1])).all(axis=1)]
        if len(kept) < 3:
            continue
        if b.has("front_plants") and b.rng.random() < 0.6:
            b.hedge(kept, draw(b.rng, b.nursery.config.hedge_height))
        elif b.fenced(0.4):
            b.enclose(kept, ("boards", "mesh", "wire")[b.rng.integers(3)], b.rng.uniform(1, 2))
    middle = plot.wall.mean(axis=0) + (house + 0.5 * deep) * plot.out
    around = np.clip(middle + b.rng.normal(0, 0.3 * deep, (60, 2)), 1, b.size - 1)
    if b.has("buildings") and b.rng.random() < 0.3:
        form: BuildingForm = "shed" if b.rng.random() < 0.6 else "garage"
        yaw = float(np.arctan2(plot.out[1], plot.out[0]))
        b.erect(building(b.rng, form), around[0], yaw)
    if b.has("trees") and b.rng.random() < 0.6:
        b.tree_among(around)
    for number in range(b.rng.poisson(5 * b.amounts["front_plants"])):
        b.shrub_among(around[number::7])


def _opening(b: Builder) -> tuple[float, float]:
    """A stretch that leaves room for the way in, at one end or at none."""
    gate = b.rng.uniform(0.1, 0.3)
    return ((0.0, 1.0), (0.0, 1 - gate), (gate, 1.0))[b.rng.integers(3)]


def _rim_plants(b: Builder, line: FloatArray) -> None:
    """A hedge, clipped or not, or a row of shrubs along the pavement."""
    if b.rng.random() < 0.6:
        b.hedge(line, draw(b.rng, b.structures.front_hedge_height))
        return
    for place in line[:: max(int(len(line) / max(length(line) / 0.9, 1)), 1)]:
        b.shrub_among(place + b.rng.normal(0, 0.25, (8, 2)))


def _by_wall(b: Builder, plot: Plot) -> None:
    """Shrubs close to the house, some of them leaning on it, low and high."""
    along = plot.wall[1] - plot.wall[0]
    number = int(b.rng.integers(2, 3 + round(float(np.linalg.norm(along)))))
    for share in b.rng.uniform(0, 1, number):
        foot = plot.wall[0] + share * along - b.rng.uniform(0.25, 0.9) * plot.out
        plant = b.nursery.shrub()
        tall = b.rng.uniform(0.4, 1.0)
        small = plant.scaled((0.8 * tall, 0.8 * tall, tall)) if b.rng.random() < 0.7 else plant
        b.plant(small, np.clip(foot, 0.5, b.size - 0.5))
