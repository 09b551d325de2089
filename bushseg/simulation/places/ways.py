"""Along ways: road verge and off-road trail."""

import numpy as np

from bushseg.simulation.materials import ASPHALT, GRAVEL, SAND, SOIL
from bushseg.simulation.places.builder import Builder
from bushseg.simulation.places.ground import BUILT
from bushseg.simulation.places.lines import beside, nearest, spaced, stretch, winding
from bushseg.simulation.places.settlement import overhead
from bushseg.simulation.structures.poles import marker, sign
from bushseg.simulation.terrain import waves


def road(b: Builder) -> None:
    """A road on its embankment, ditches, guard rail, signs, passing cars, shrubs on the verge."""
    b.path = winding(b.rng, b.size, bend=0.05)
    half = b.rng.uniform(2.6, 4.2)
    b.ground.grade(b.path, half + 0.8, b.rng.uniform(1.5, 4), lift=b.rng.uniform(-0.5, 0.9))
    b.ground.lay(b.ground.within(b.path, half + 0.8), GRAVEL)
    b.ground.lay(b.ground.within(b.path, half), ASPHALT)
    b.bare |= b.ground.within(b.path, half + 0.3)
    b.ground.clear(b.path, half + 0.5)
    for side in (-1, 1):
        if b.rng.random() < 0.7:
            ditch = beside(b.path, side * (half + b.rng.uniform(2.2, 3.2)))
            b.ground.trench(ditch, b.rng.uniform(0.6, 1.2), b.rng.uniform(0.25, 0.9))
        if b.fenced(0.45):
            rail = stretch(beside(b.path, side * (half + 0.7)), *np.sort(b.rng.uniform(0, 1, 2)))
            b.enclose(rail, "guard rail", 0.75)
    for side in (-1, 1):
        edge = beside(b.path, side * (half + 1.0))
        where, yaws = spaced(edge, b.rng.uniform(8, 20), start=2.0)
        if not b.has("poles"):
            where, yaws = where[:0], yaws[:0]
        for place, yaw in zip(where, yaws, strict=True):
            inside = np.clip(place, 0.5, b.size - 0.5)
            model = sign(b.rng) if b.rng.random() < 0.3 else marker(b.rng)
            b.add(model, "man-made", inside, float(yaw) + (side > 0) * np.pi)
            b.ground.take(inside[None], np.array([0.15]), BUILT)
        beyond = beside(b.path, side * (half + b.rng.uniform(4, 6)))
        if b.has("hedges") and b.rng.random() < 0.3:
            b.hedgerow(np.clip(beyond, 0.8, b.size - 0.8))
        elif b.fenced(0.35):
            b.enclose(np.clip(beyond, 0.8, b.size - 0.8), "wire", 1.2)
    if b.rng.random() < 0.5:
        overhead(b, beside(b.path, b.rng.choice((-1, 1)) * (half + 6)))
    _traffic(b, half)
    lane = np.clip(beside(b.path, -0.45 * half), 0.5, b.size - 0.5)
    b.ground.clear(lane, 0.5)
    b.path = lane  # one drives on the right


def _traffic(b: Builder, half: float) -> None:
    """Set the site's vehicles on the left lane, coming, each where there is room."""
    for _ in range(b.count("vehicles")):
        where, yaws = spaced(beside(b.path, half / 2), 1.0, start=3.0)
        pick = b.rng.integers(len(where))
        place = np.clip(where[pick], 2, b.size - 2)
        if b.ground.at(b.ground.clearance(BUILT), place[None])[0] < 3.0:
            continue
        b.add(
            b.vehicle("tractor" if b.rng.random() < 0.15 else None),
            "vehicle or person",
            place,
            float(yaws[pick]) + np.pi,
        )
        b.ground.take(place[None], np.array([1.0]), BUILT)
    b.amounts["vehicles"] = 0.0


def trail(b: Builder) -> None:
    """A rutted track through tall grass, bushes close to it, rocks and puddles."""
    b.path = winding(b.rng, b.size, bend=0.2)
    half = b.rng.uniform(0.9, 1.5)
    b.ground.grade(b.path, half, shoulder=1.5)
    rutted = b.rng.uniform(0.6, 0.85)
    for side in (-rutted, rutted):
        b.ground.trench(beside(b.path, side), 0.28, b.rng.uniform(0.04, 0.2))
    b.ground.lay(b.ground.within(b.path, half), (SOIL, SAND)[b.rng.integers(2)])
    distance, _, _ = nearest(b.path, b.ground.centers())
    worn = np.abs(np.abs(distance) - rutted) < 0.35
    b.bare |= worn.reshape(b.bare.shape)
    b.ground.clear(b.path, half)
    # Shrubs like the light of the track.
    close = np.exp(-(((np.abs(distance) - half) / 4.0) ** 2)).reshape(b.scrub.shape)
    clumpy = waves(b.rng, b.ground.centers(), shortest=5, longest=25).reshape(b.scrub.shape)
    b.scrub = 0.15 + close * (clumpy > -0.3)
    b.woods = np.clip(1.0 - close + 0.15, 0, 1) * (clumpy > -0.8)
    if b.fenced(0.2):
        b.enclose(beside(b.path, b.rng.choice((-1, 1)) * (half + 2)), "wire", 1.2)
