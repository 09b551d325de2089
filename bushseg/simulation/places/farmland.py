"""Farmland and parks: orchard, hedged fields, park."""

import numpy as np

from bushseg.simulation.materials import ASPHALT, GRAVEL, MEADOW, SOIL
from bushseg.simulation.places.builder import Builder
from bushseg.simulation.places.lines import beside, loop, nearest, winding
from bushseg.simulation.places.settlement import edges, mow, overhead
from bushseg.simulation.structures.furniture import FURNITURE


def orchard(b: Builder) -> None:
    """Rows of fruit trees, grass mown between them, a hedge or fence at the border."""
    b.path = winding(b.rng, b.size, bend=0.02)
    b.ground.clear(b.path, 1.2)
    azimuth = b.yaw()
    along = np.array([np.cos(azimuth), np.sin(azimuth)])
    across = np.array([-along[1], along[0]])
    density = b.amounts["trees"] / 1000
    apart = np.sqrt(1 / max(density, 1e-3))
    rows, steps = apart * b.rng.uniform(1.0, 1.35), apart * b.rng.uniform(0.75, 0.95)
    number = int(b.size / min(rows, steps)) + 2
    i, j = np.meshgrid(*[np.arange(-number, number + 1)] * 2, indexing="ij")
    places = b.size / 2 + i.ravel()[:, None] * rows * across + j.ravel()[:, None] * steps * along
    places += b.rng.normal(0, 0.15, places.shape)
    inside = ((places > 1.5) & (places < b.size - 1.5)).all(axis=1)
    for place in places[inside] if density > 0 else ():
        if b.rng.random() < 0.93:  # gaps, where a tree has died
            b.tree_at(place)
    b.amounts["trees"] = 0.0
    strips = np.abs((b.ground.centers() - b.size / 2) @ across / rows % 1.0 - 0.5)
    b.mown |= (strips < 0.5 * b.amounts["mown"]).reshape(b.mown.shape)
    _border(b)


def fields(b: Builder) -> None:
    """Meadows with hedgerows between them, on banks and by ditches; a track, single trees."""
    b.path = winding(b.rng, b.size, bend=0.08)
    b.ground.lay(b.ground.within(b.path, 1.2), SOIL)
    for side in (-0.75, 0.75):
        b.ground.trench(beside(b.path, side), 0.3, b.rng.uniform(0.02, 0.1))
    b.ground.clear(b.path, 1.4)
    left = b.amounts["hedges"] * b.size**2 / 1000
    lines = [beside(b.path, b.rng.choice((-1, 1)) * b.rng.uniform(2.5, 4.5))]
    lines += [winding(b.rng, b.size, bend=0.05) for _ in range(4)]
    for line in lines:
        part = np.clip(line[: max(int(left), 0)], 0.8, b.size - 0.8)
        left -= len(part)
        if len(part) < 4:
            break
        if b.rng.random() < 0.4:
            b.ground.bank(part, 1.2, b.rng.uniform(0.2, 0.7))
        if b.rng.random() < 0.4:
            b.ground.trench(beside(part, 1.8), 0.7, b.rng.uniform(0.3, 0.8))
        if b.fenced(0.4):
            b.enclose(beside(part, -1.2), "wire", b.rng.uniform(1.0, 1.3))
        b.hedgerow(part)
    b.amounts["hedges"] = 0.0
    off, _, _ = nearest(lines[0], b.ground.centers())
    cut = (off > 0).reshape(b.mown.shape)
    if b.rng.random() < b.amounts["mown"] * 2:
        b.mown |= cut
        b.ground.lay(cut & (b.ground.covered == 0), MEADOW)
        for _ in range(b.count("furniture", 2.0)):
            b.stand(FURNITURE["hay bale"](b.rng), "man-made", 1.0)
    b.scrub = np.where(cut, 0.25, 1.0)
    if b.rng.random() < 0.3:
        overhead(b, beside(b.path, -5.0))


def park(b: Builder) -> None:
    """Lawns and winding paved ways, groups of trees, shrub beds, benches and a playground."""
    b.path = loop(b.rng, b.size) if b.rng.random() < 0.5 else winding(b.rng, b.size, bend=0.3)
    half, paving = b.rng.uniform(0.9, 1.6), (ASPHALT, GRAVEL)[b.rng.integers(2)]
    ways = (b.path, winding(b.rng, b.size, bend=0.2))
    for way in ways:
        b.ground.grade(way, half, shoulder=1.0)
        b.ground.lay(b.ground.within(way, half), paving)
        b.ground.clear(way, half)
        b.bare |= b.ground.within(way, half)
    for name in 2 * ("bench", "bench", "bin") if b.has("furniture") else ():
        where = b.along(ways[b.rng.integers(2)], half + 0.6)
        b.stand(FURNITURE[name](b.rng), "man-made", 0.5, where)
    for _ in range(b.count("buildings")):
        b.build("shed" if b.rng.random() < 0.5 else "flat", b.anywhere(), b.yaw())
    if b.has("furniture") and b.rng.random() < 0.5:
        _playground(b)
    groups = b.rng.uniform(0, b.size, (4, 2))
    near = np.linalg.norm(b.ground.centers()[:, None] - groups, axis=2).min(axis=1)
    b.woods = np.exp(-((near / (0.15 * b.size)) ** 2)).reshape(b.woods.shape) + 0.1
    for _ in range(b.count("hedges", 0.2)):
        start, yaw = b.anywhere(1)[0], b.yaw()
        end = np.clip(start + 5 * np.array([np.cos(yaw), np.sin(yaw)]), 1, b.size - 1)
        b.hedge(np.linspace(start, end, 6))
    mow(b)


def _playground(b: Builder) -> None:
    """Set up a swing, a climbing frame and a table close to each other."""
    center = b.ground.claim(b.anywhere(), 4.0, keep=0.0)
    if center is None:
        return
    for name in ("swing", "climbing frame", "table"):
        around = center + b.rng.normal(0, 2.0, (40, 2))
        b.stand(FURNITURE[name](b.rng), "man-made", 1.3, around)


def _border(b: Builder) -> None:
    """Hedge, fence or leave open the site's edges."""
    left = b.amounts["hedges"] * b.size**2 / 1000
    for start, end in edges(b.size):
        line = np.linspace(start, end, 12)
        if left > b.size / 2:
            b.hedgerow(line)
            left -= b.size
        elif b.fenced(0.6):
            kinds = ("wire", "wire", "picket", "wall")
            b.enclose(line, kinds[b.rng.integers(4)], b.rng.uniform(0.9, 1.4))
