"""What makes a front of a wall: windows, balconies, dormers, doors."""

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import CONCRETE, GLASS, METAL, PANE, TILES, WOOD, Material
from bushseg.simulation.mesh import Mesh, Model, Surface, box, join, polyhedron

STOREY = 2.7
"""From floor to floor, metres."""

BALCONY = 0.55
"""How far balconies and porches stand out, metres."""


def windows(rng: np.random.Generator, length: float, y: float, eaves: float) -> Model:
    """Panes in both long walls, a row a storey, none where the door is; curtained ones are seen."""
    number = max(round(length / rng.uniform(2.2, 4.5)), 1)
    half, tall, sill = rng.uniform(0.35, 0.9), rng.uniform(1.0, 1.6), rng.uniform(0.7, 1.1)
    half = min(half, 0.4 * length / number)
    columns = (np.arange(number) + 0.5) / number * length - length / 2
    dark: list[Mesh] = []
    seen: list[Mesh] = []
    for floor in np.arange(0.0, max(eaves - sill - tall, 0.1), STOREY):
        for side in (-1, 1):
            for at in columns:
                if side == -1 and floor == 0 and abs(at) < half + 0.6:
                    continue
                low = (at - half, side * y - 0.03, floor + sill)
                high = (at + half, side * y + 0.03, min(floor + sill + tall, eaves - 0.1))
                (seen if rng.random() < 0.3 else dark).append(box(low, high))
    return [Surface(join(part), of) for part, of in ((dark, PANE), (seen, GLASS)) if part]


def balconies(rng: np.random.Generator, length: float, y: float, eaves: float) -> Model:
    """Balconies with railings or parapets on the front, one above the other."""
    floors = np.arange(STOREY, eaves - 2.0, STOREY)
    places: FloatArray = rng.uniform(-0.3, 0.3, 2) * length
    solid = rng.random() < 0.5
    parts: list[Mesh] = []
    rails: list[Mesh] = []
    for z in floors:
        for at in places[: 1 + (abs(places[0] - places[1]) > 4)]:
            x, front = at - 1.4, -y - BALCONY
            parts.append(box((x, front, z), (x + 2.8, -y, z + 0.15)))
            if solid:
                parts.append(box((x, front, z + 0.15), (x + 2.8, front + 0.05, z + 1.05)))
                continue
            rails.append(box((x, front, z + 1.0), (x + 2.8, front + 0.04, z + 1.05)))
            rails += [
                box((x + s, front + 0.01, z + 0.15), (x + s + 0.02, front + 0.03, z + 1.0))
                for s in np.arange(0.05, 2.8, 0.13)
            ]
    model = [Surface(join(parts), CONCRETE)] if parts else []
    return model + ([Surface(join(rails), METAL)] if rails else [])


def dormer(at: float, y: float, eaves: float, ridge: float, side: int, walls: Material) -> Model:
    """A dormer on one half of a gable roof, at `at` metres along it."""
    slope = (ridge - eaves) / y
    low, top = eaves + 0.25 * (ridge - eaves), eaves + 0.8 * (ridge - eaves)
    outer, inner = y - (low - eaves) / slope, max(y - (top - eaves) / slope, 0.0)
    corners = [
        (at + s * 0.8, side * t, z)
        for s in (-1, 1)
        for t, z in ((outer, low), (outer, top), (inner, top))
    ]
    body = polyhedron(corners, [(0, 1, 4, 3), (0, 1, 2), (3, 4, 5)])
    roof = box(
        (at - 1.0, min(side * inner, side * (outer + 0.2)), top),
        (at + 1.0, max(side * inner, side * (outer + 0.2)), top + 0.1),
    )
    pane = box(
        (at - 0.5, side * outer - 0.03, low + 0.15), (at + 0.5, side * outer + 0.03, top - 0.1)
    )
    return [Surface(body, walls), Surface(roof, TILES), Surface(pane, PANE)]


def door(y: float, footing: float) -> Surface:
    """The door in the middle of the front."""
    return Surface(box((-0.5, -y - 0.04, -footing), (0.5, -y + 0.02, 2.1)), WOOD)


def porch(rng: np.random.Generator, y: float) -> Model:
    """A small roof over the door, on posts or on none."""
    roof = box((-1.0, -y - BALCONY, 2.3), (1.0, -y, 2.42))
    steps = box((-0.8, -y - BALCONY, -0.3), (0.8, -y, rng.uniform(0.1, 0.3)))
    posts = [
        box((s * 0.95 - 0.05, -y - BALCONY + 0.02, 0), (s * 0.95 + 0.05, -y - BALCONY + 0.12, 2.3))
        for s in (-1, 1)
    ]
    return [
        Surface(join([roof, *(posts if rng.random() < 0.5 else [])]), WOOD),
        Surface(steps, CONCRETE),
    ]
