"""Woods and wild ground: forest edge, forest interior, heath."""

import numpy as np

from bushseg.simulation.materials import LITTER, SAND, SOIL
from bushseg.simulation.places.builder import Builder
from bushseg.simulation.places.lines import beside, nearest, winding
from bushseg.simulation.terrain import waves


def forest_edge(b: Builder) -> None:
    """Wood on one side, a mantle of shrubs along its edge, meadow with a track on the other."""
    edge = winding(b.rng, b.size, bend=0.12)
    distance, _, _ = nearest(edge, b.ground.centers())
    distance += 1.5 * waves(b.rng, b.ground.centers(), shortest=4, longest=15)
    distance = distance.reshape(b.woods.shape)
    b.path = beside(edge, b.rng.choice((-7.0, -4.0)))
    b.path = b.path[((b.path > 1) & (b.path < b.size - 1)).all(axis=1)]
    if len(b.path) < b.size / 2:
        b.path = edge
    b.ground.lay(distance > 1.0, LITTER)
    if b.rng.random() < 0.6:
        b.ground.lay(b.ground.within(b.path, 1.0), SOIL)
        b.bare |= b.ground.within(b.path, 0.6)
    b.ground.clear(b.path, 1.1)
    b.woods = np.where(distance > 0, 1.0, 0.015)
    b.scrub = 0.12 + np.exp(-((distance / 2.5) ** 2))
    b.mown |= distance < -6
    if b.fenced(0.3):
        b.enclose(beside(b.path, -2.0), "wire", 1.2)


def forest(b: Builder) -> None:
    """Stems, their undergrowth in patches, dead wood; a footpath winds through."""
    b.path = winding(b.rng, b.size, bend=0.25)
    b.ground.lay(np.ones_like(b.bare), LITTER)
    if b.rng.random() < 0.5:
        b.ground.lay(b.ground.within(b.path, 0.7), SOIL)
    b.ground.clear(b.path, 0.8)
    for _ in range(b.count("trees", 0.15)):  # a walker passes stems within reach
        b.tree_among(b.along(b.path, b.rng.uniform(1.2, 2.5)))
    patches = waves(b.rng, b.ground.centers(), shortest=5, longest=25).reshape(b.scrub.shape)
    b.scrub = 1 / (1 + np.exp(-2.5 * (patches - 0.3)))
    openings = waves(b.rng, b.ground.centers(), shortest=12, longest=40).reshape(b.scrub.shape)
    b.woods = np.clip(1.2 + 0.6 * openings, 0.05, 1)


def heath(b: Builder) -> None:
    """Scrub of all sizes in tall grass, a sandy footpath, few trees."""
    b.path = winding(b.rng, b.size, bend=0.25)
    if b.rng.random() < 0.7:
        b.ground.lay(b.ground.within(b.path, 0.9), SAND)
        b.bare |= b.ground.within(b.path, 0.7)
    b.ground.clear(b.path, 1.0)
    patches = waves(b.rng, b.ground.centers(), shortest=6, longest=35).reshape(b.scrub.shape)
    b.scrub = 1 / (1 + np.exp(-2.0 * (patches + b.rng.uniform(-0.5, 1.0))))
    b.ground.lay((patches < -1.2) & (b.ground.covered == 0), SAND)
