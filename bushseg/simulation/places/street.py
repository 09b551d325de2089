"""A street: houses on both sides, planted front gardens, parked cars, trees at the kerb."""

from dataclasses import dataclass

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import ASPHALT, CONCRETE, LAWN
from bushseg.simulation.places.builder import Builder
from bushseg.simulation.places.frontage import back, front, rows
from bushseg.simulation.places.ground import BUILT, WAY
from bushseg.simulation.places.lines import beside, length, spaced, winding
from bushseg.simulation.places.settlement import mow, overhead
from bushseg.simulation.plants.distributions import draw
from bushseg.simulation.structures.furniture import FURNITURE
from bushseg.simulation.structures.vehicles import bicycle

PARKING = 2.2
"""Width of a strip of parked cars, metres."""


@dataclass(frozen=True, slots=True)
class Section:
    """A street's cross-section, metres from its middle, the same to both sides.

    Attributes:
        lanes: Where the carriageway ends.
        kerb: Where parked cars end.
        verge: Where a strip of grass or trees ends; the kerb where there is none.
        pavement: Where front gardens begin.
    """

    lanes: float
    kerb: float
    verge: float
    pavement: float


def street(b: Builder) -> None:
    """Lay a street out from its middle to the houses."""
    middle = winding(b.rng, b.size, bend=b.rng.uniform(0, 0.06))
    section = _section(b)
    b.ground.grade(middle, section.pavement + 0.5, shoulder=3.0)
    b.ground.lay(b.ground.within(middle, section.pavement), CONCRETE)
    if section.verge > section.kerb:
        b.ground.lay(b.ground.within(middle, section.verge), LAWN)
    paved = b.ground.within(middle, section.kerb)
    b.ground.lay(paved, ASPHALT)
    b.bare |= b.ground.within(middle, section.pavement)
    if section.verge > section.kerb:
        b.bare &= ~(b.ground.within(middle, section.verge) & ~paved)
    b.ground.clear(middle, section.lanes)
    on_foot = b.rng.random() < 0.25
    b.path = beside(middle, -(section.pavement - 0.9 if on_foot else 0.4 * section.lanes))
    b.path = b.path[((b.path > 1) & (b.path < b.size - 1)).all(axis=1)]
    b.ground.clear(b.path, 0.6)
    for side in (-1, 1):
        _parked(b, beside(middle, side * (section.lanes + PARKING / 2)))
    _moving(b, beside(middle, 0.5 * section.lanes))
    for side in (-1, 1):
        _trees(
            b,
            beside(
                middle,
                side
                * (section.verge - 0.6 if section.verge > section.kerb else section.kerb + 0.4),
            ),
        )
    plots = list(rows(b, middle, section.pavement))
    for plot in plots:
        front(b, plot)
    for plot in plots:
        back(b, plot)
    _small(b, middle, section)
    if b.rng.random() < 0.25:
        overhead(b, beside(middle, b.rng.choice((-1, 1)) * (section.kerb + 0.4)))
    mow(b)


def _section(b: Builder) -> Section:
    """Draw a cross-section, narrower where the site is small."""
    lanes = b.rng.uniform(2.8, np.clip(b.size / 12, 3.0, 5.2))
    kerb = lanes + PARKING
    verge = kerb + (b.rng.uniform(1.2, 2.5) if b.size > 55 and b.rng.random() < 0.4 else 0.0)
    return Section(lanes, kerb, verge, verge + b.rng.uniform(1.5, 2.8))


def _parked(b: Builder, line: FloatArray) -> None:
    """Park cars nose to tail along a kerb, or side by side; plants grow in some of the gaps."""
    if not b.has("parked"):
        return
    share = np.clip(b.amounts["parked"] * b.rng.uniform(0.5, 1.4), 0, 1)
    at = b.rng.uniform(0, 4)
    total = length(line)
    while at < total - 5:
        bay = 5.0
        if b.rng.random() < share:
            car = b.vehicle()
            long = max(float(np.ptp(mesh.vertices[:, 0])) for mesh, _ in car)
            bay = long + draw(b.rng, b.structures.parking_gap)
            where, yaws = spaced(line, total, start=at + long / 2)
            place = where[:1] + b.rng.normal(0, 0.1, (1, 2))
            room = b.ground.at(b.ground.clearance(WAY, WAY), place)[0]
            inside = ((place > 2.5) & (place < b.size - 2.5)).all()
            if inside and room > 0.75:
                turned = float(yaws[0]) + b.rng.normal(0, 0.03) + np.pi * b.rng.integers(2)
                b.add(car, "vehicle or person", place[0], turned)
                spots, _ = spaced(line, 0.8, start=max(at + 0.6, 0))
                spots = spots[: max(int(long / 0.8) - 1, 1)]
                b.ground.take(spots, np.full(len(spots), 0.9), BUILT)
        elif b.has("front_plants") and b.rng.random() < 0.15:
            spot, _ = spaced(line, total, start=at + 1.5)
            b.shrub_among(spot + b.rng.normal(0, 0.5, (20, 2)))
        at += bay


def _moving(b: Builder, line: FloatArray) -> None:
    """Set the site's moving vehicles on the lane that the sensor is not on."""
    for _ in range(b.count("vehicles")):
        where, yaws = spaced(line, 1.0, start=3.0)
        inner = ((where > 3) & (where < b.size - 3)).all(axis=1)
        where, yaws = where[inner], yaws[inner]
        if not len(where):
            break
        pick = b.rng.integers(len(where))
        place = where[pick]
        way = np.linalg.norm(b.path - place, axis=1).min()
        if b.ground.at(b.ground.clearance(BUILT), place[None])[0] < 1.0 or way < 1.4:
            continue
        b.add(b.vehicle(), "vehicle or person", place, float(yaws[pick]) + np.pi)
        b.ground.take(place[None], np.array([2.0]), BUILT)
    b.amounts["vehicles"] = 0.0


def _trees(b: Builder, line: FloatArray) -> None:
    """Plant trees with bare trunks along a kerb."""
    if not b.has("trees") or b.rng.random() < 0.35:
        return
    where, _ = spaced(line, b.rng.uniform(7, 14), start=b.rng.uniform(1, 8))
    for place in where:
        inside = ((place > 1) & (place < b.size - 1)).all()
        if not inside or b.rng.random() < 0.15:
            continue
        if b.ground.at(b.ground.clearance(WAY), place[None])[0] < 0.35:
            continue
        tree = b.nursery.street_tree(draw(b.rng, b.structures.street_trunk))
        b.plant(tree, place)
        b.trunks.append((place[0], place[1], tree.radius))


def _small(b: Builder, middle: FloatArray, section: Section) -> None:
    """Bins and bicycles on the pavement, by the gardens."""
    for _ in range(b.count("furniture")):
        where = b.along(middle, section.pavement - 0.3)
        if b.rng.random() < 0.5:
            b.stand(FURNITURE["bin"](b.rng), "man-made", 0.4, where)
        else:
            b.stand(bicycle(b.rng), "vehicle or person", 0.5, where)
