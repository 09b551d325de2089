"""Where people live and work: garden, village, yard."""

from itertools import pairwise

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import ASPHALT, CONCRETE, GRAVEL, SOIL
from bushseg.simulation.mesh import placed
from bushseg.simulation.places.builder import CANDIDATES, Builder
from bushseg.simulation.places.ground import BUILT, WAY
from bushseg.simulation.places.lines import beside, nearest, spaced, stretch, winding
from bushseg.simulation.structures.buildings import BuildingForm
from bushseg.simulation.structures.earth import heap
from bushseg.simulation.structures.poles import power_pole, wires

EDGE = 0.8
"""Where a boundary runs, metres from the site's edge."""


def garden(b: Builder) -> None:
    """A house in its garden: drive, hut, boundaries of all kinds, shrubs along them."""
    b.path = winding(b.rng, b.size, bend=0.12)
    b.ground.clear(b.path, 0.9)
    forms: tuple[BuildingForm, ...] = ("shed", "greenhouse", "shed", "gable", "flat")
    for number in range(b.count("buildings")):
        form = forms[b.rng.integers(3, 5) if number == 0 else b.rng.integers(5)]
        house = b.build(form, b.anywhere(), b.rng.uniform(-0.3, 0.3))
        if house is not None and number == 0:
            _drive(b, house)
        if house is not None and b.has("front_plants"):
            _around(b, house)
    for start, end in edges(b.size):
        _boundary(b, np.linspace(start, end, 8), ("picket", "wall", "wire", "boards", "hedge"))
    mow(b)


def village(b: Builder) -> None:
    """Houses along a street, front gardens fenced or hedged, cars parked, wires overhead."""
    b.path = winding(b.rng, b.size, bend=0.06)
    half = b.rng.uniform(2.8, 4.4)
    b.ground.grade(b.path, half, shoulder=2.5)
    b.ground.lay(b.ground.within(b.path, half + 1.3), CONCRETE)  # pavements
    b.ground.lay(b.ground.within(b.path, half), ASPHALT)
    b.ground.clear(b.path, half + 1.3)
    b.bare |= b.ground.within(b.path, half + 1.2)
    forms: tuple[BuildingForm, ...] = ("gable", "gable", "flat", "barn", "shed")
    for _ in range(b.count("buildings")):
        side = b.rng.choice((-1, 1))
        where, yaws = spaced(beside(b.path, side * (half + b.rng.uniform(7, 10))), 1.0)
        pick = b.rng.integers(len(where), size=CANDIDATES)
        house = b.build(forms[b.rng.integers(5)], where[pick], float(np.median(yaws)))
        if house is not None and b.rng.random() < 0.7:
            _drive(b, house)
        if house is not None and b.has("front_plants"):
            _around(b, house)
    for side in (-1, 1):
        front = beside(b.path, side * (half + 2.0))
        for part in range(4):
            kinds = ("picket", "wall", "wall", "boards", "mesh", "hedge", "hedge", "hedge", "hedge")
            _boundary(b, stretch(front, part / 4, (part + 1) / 4), kinds)
        for at in b.rng.uniform(0.15, 0.85, 2):  # between neighbors
            line = stretch(front, at, min(at + 0.05, 1.0))
            across = side * (beside(line, 1.0)[0] - line[0])
            far = line[0] + across * min(b.size / 3, 14)
            inside = np.clip(np.linspace(line[0], far, 8), EDGE, b.size - EDGE)
            _boundary(b, inside, ("picket", "wire", "boards", "hedge", "wall"))
    overhead(b, beside(b.path, b.rng.choice((-1, 1)) * (half + 1.0)))
    _park(b, b.path, half - 0.9)
    b.path = np.clip(beside(b.path, -0.4 * half), 1.0, b.size - 1.0)
    b.ground.clear(b.path, 0.6)
    mow(b)


def yard(b: Builder) -> None:
    """A building site or farmyard: gravel, heaps, stacks, a fence around, weeds by the fence."""
    b.path = winding(b.rng, b.size, bend=0.15)
    b.ground.clear(b.path, 1.6)
    middle = np.linalg.norm(b.ground.centers() - b.size / 2, axis=1) / b.size
    rough = b.rng.normal(0, 0.03, middle.shape)
    yard_cells = (middle + rough < b.rng.uniform(0.3, 0.45)).reshape(b.bare.shape)
    b.ground.lay(yard_cells, GRAVEL if b.rng.random() < 0.6 else SOIL)
    b.ground.lay(b.ground.within(b.path, 1.6), SOIL)
    b.bare |= yard_cells
    b.scrub = np.where(yard_cells, 0.08, 1.0)
    b.woods = np.where(yard_cells, 0.02, 1.0)
    forms: tuple[BuildingForm, ...] = ("barn", "flat", "shed", "gable")
    for _ in range(b.count("buildings")):
        b.build(forms[b.rng.integers(4)], b.anywhere(), b.yaw())
    for start, end in edges(b.size):
        _boundary(b, np.linspace(start, end, 8), ("mesh", "boards", "concrete", "wire"))
    heaps = int(b.rng.integers(1, 2 + round(b.size / 15))) if b.has("rocks") else 0
    for _ in range(heaps):
        radius = b.rng.uniform(1.0, 3.2)
        place = b.ground.claim(b.anywhere(), 0.8 * radius)
        if place is None:
            continue
        b.scene.add(
            placed(heap(b.rng, radius), b.ground.terrain.point(place), b.yaw()),
            "ground",
            instance=False,
        )


def edges(size: float) -> list[tuple[FloatArray, FloatArray]]:
    """The four lines along a site's edges."""
    near, far = EDGE, size - EDGE
    ring = np.array([(near, near), (far, near), (far, far), (near, far), (near, near)])
    return list(pairwise(ring))


def _boundary(b: Builder, line: FloatArray, kinds: tuple[str, ...]) -> None:
    """Put a hedge, fence or wall along a line, or leave it open; sometimes a hedge behind."""
    if not b.fenced(0.85):
        return
    kind = kinds[b.rng.integers(len(kinds))]
    if kind == "hedge":
        if b.has("hedges"):
            b.hedge(line)
        return
    high = 2.0 if kind in ("boards", "mesh", "concrete") else 1.5
    b.enclose(line, kind, b.rng.uniform(0.8, high))
    if b.has("hedges") and b.rng.random() < 0.35:
        inward = min((beside(line, s) for s in (-0.9, 0.9)), key=lambda at: _off_middle(b, at))
        b.hedge(stretch(inward, *sorted(b.rng.uniform(0, 1, 2))))


def _off_middle(b: Builder, line: FloatArray) -> float:
    return float(np.linalg.norm(line - b.size / 2, axis=1).mean())


def _drive(b: Builder, house: tuple[FloatArray, float]) -> None:
    """Lay a drive from a house to the path, and park on it."""
    place, radius = house
    _, (on,), _ = nearest(b.path, place[None])
    toward = (on - place) / max(float(np.linalg.norm(on - place)), 1e-6)
    line = np.linspace(place + toward * radius, on, 12)
    cells = b.ground.within(line, 1.4) & (b.ground.taken < BUILT)
    b.ground.lay(cells, (GRAVEL, CONCRETE)[b.rng.integers(2)])
    b.bare |= cells
    if b.has("vehicles") and b.rng.random() < 0.6 and np.linalg.norm(line[-1] - line[0]) > 5:
        yaw = float(np.arctan2(toward[1], toward[0]))
        b.stand(b.vehicle(), "vehicle or person", 1.2, line[2:5], yaw)
    b.ground.reserve(cells, WAY)


def _around(b: Builder, house: tuple[FloatArray, float]) -> None:
    """Shrubs against a house and close to it; now and then a small tree."""
    place, radius = house
    number = b.rng.poisson(10 * b.amounts["front_plants"])
    for _ in range(number):
        turn = b.rng.uniform(0, 2 * np.pi, 24)
        out = radius * b.rng.uniform(0.55, 1.2, 24)
        b.shrub_among(place + out[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    if b.has("trees") and b.rng.random() < 0.5:
        turn = b.rng.uniform(0, 2 * np.pi, 40)
        b.tree_among(place + 1.3 * radius * np.stack([np.cos(turn), np.sin(turn)], axis=1))


def _park(b: Builder, line: FloatArray, off: float) -> None:
    """Park the site's vehicles along a street."""
    for _ in range(b.count("vehicles")):
        where, yaws = spaced(beside(line, off), 1.0)  # one drives on the right
        inner = slice(3, -3) if len(where) > 12 else slice(None)
        pick = b.rng.integers(len(where[inner]))
        place = where[inner][pick]
        if (b.ground.at(b.ground.clearance(BUILT), place[None]) < 2.3)[0]:
            continue
        b.add(b.vehicle(), "vehicle or person", place, float(yaws[inner][pick]))
        b.ground.take(place[None], np.array([1.2]), BUILT)
    b.amounts["vehicles"] = 0.0


def overhead(b: Builder, line: FloatArray) -> None:
    """Set poles along a line and hang wires between them."""
    if not b.has("poles"):
        return
    height = b.rng.uniform(7, 9.5)
    where, yaws = spaced(line, b.rng.uniform(14, 24), start=b.rng.uniform(1, 5))
    tops = []
    for place, yaw in zip(where, yaws, strict=True):
        inside = np.clip(place, 0.5, b.size - 0.5)
        b.add(power_pole(height), "man-made", inside, float(yaw))
        b.ground.take(inside[None], np.array([0.3]), BUILT)
        tops.append(b.ground.terrain.point(inside) + np.array([0, 0, height - 0.4]))
    if len(tops) > 1:
        b.scene.add(wires(np.array(tops), b.rng.uniform(0.3, 1.0)), "man-made")


def mow(b: Builder) -> None:
    """Mow a share of the ground, in one piece, around the path."""
    distance, _, _ = nearest(b.path, b.ground.centers())
    reach = np.quantile(np.abs(distance), np.clip(b.amounts["mown"], 0, 1))
    b.mown |= (np.abs(distance) <= reach).reshape(b.mown.shape)
