"""Cars, vans and tractors, along x."""

from collections.abc import Callable

import numpy as np

from bushseg.simulation.materials import GLASS, METAL, PAINT, RUBBER
from bushseg.simulation.mesh import Mesh, Model, Surface, box, join, polyhedron, tube


def car(rng: np.random.Generator) -> Model:
    """A car, about 4.3 m long."""
    x, y = 2.15 * rng.uniform(0.85, 1.1), 0.88
    body = _body(x, y, 0.25, 0.85)
    roof = 1.45 * rng.uniform(0.97, 1.2)
    rear = rng.uniform(-0.95, -0.75)  # estate or saloon
    rings = [(rear * x, 0.45 * x, y - 0.04, 0.85), ((rear + 0.2) * x, 0.12 * x, y - 0.2, roof)]
    cabin = polyhedron(
        [
            (px, side * py, z)
            for back, front, py, z in rings
            for px in (back, front)
            for side in (-1, 1)
        ],
        [(4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)],
    )
    lid = box(((rear + 0.22) * x, 0.22 - y, roof), (0.1 * x, y - 0.22, roof + 0.03))
    return [
        Surface(join([body, lid]), PAINT[rng.integers(len(PAINT))]),
        Surface(cabin, GLASS),
        Surface(_wheels(0.62 * x, -0.62 * x, y, 0.31, 0.31), RUBBER),
    ]


def van(rng: np.random.Generator) -> Model:
    """A van or a box body, 5 to 6.5 m long."""
    x, y, roof = rng.uniform(2.5, 3.2), 1.0, rng.uniform(1.9, 2.8)
    body = join([_body(x, y, 0.35, 1.1), box((-x, -y, 1.1), (0.55 * x, y, roof))])
    front = [(0.55 * x, z, s * y) for z in (1.1, roof) for s in (-1, 1)]
    front += [(0.85 * x, 1.1, s * y) for s in (-1, 1)]
    shield = polyhedron(
        [(px, py, pz) for px, pz, py in front], [(2, 3, 5, 4), (0, 2, 4), (1, 3, 5)]
    )
    return [
        Surface(body, PAINT[rng.integers(len(PAINT))]),
        Surface(shield, GLASS),
        Surface(_wheels(0.65 * x, -0.6 * x, y, 0.34, 0.34), RUBBER),
    ]


def tractor(rng: np.random.Generator) -> Model:
    """A tractor, about 4 m long, large wheels behind."""
    x, y = rng.uniform(1.8, 2.2), 0.95
    hood = box((0, -0.4, 0.7), (x, 0.4, 1.45))
    posts = [
        tube([(px, s * 0.65, 1.2), (px, s * 0.6, 2.6)], [0.04, 0.04], 4)
        for px in (-0.7 * x, -0.05 * x)
        for s in (-1, 1)
    ]
    roof = box((-0.75 * x, -0.7, 2.6), (0.02 * x, 0.7, 2.72))
    seat = box((-0.7 * x, -0.65, 0.7), (-0.05 * x, 0.65, 1.25))
    exhaust = tube([(0.7 * x, 0.3, 1.4), (0.7 * x, 0.3, 2.4)], [0.04, 0.04])
    return [
        Surface(join([hood, roof, seat]), PAINT[rng.integers(len(PAINT))]),
        Surface(join([*posts, exhaust]), METAL),
        Surface(_wheels(0.75 * x, -0.55 * x, y, 0.45, 0.8), RUBBER),
    ]


VEHICLES: dict[str, Callable[[np.random.Generator], Model]] = {
    "car": car,
    "van": van,
    "tractor": tractor,
}


def _body(x: float, y: float, low: float, high: float) -> Mesh:
    """A box open below."""
    return polyhedron(
        [(sx * x, sy * y, z) for z in (low, high) for sx in (-1, 1) for sy in (-1, 1)],
        [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)],
    )


def _wheels(front: float, rear: float, y: float, front_radius: float, rear_radius: float) -> Mesh:
    """Four wheels of the given radii, their axles at `front` and `rear`, metres."""
    return join(
        [
            tube([(at, s * y - 0.1, r), (at, s * y + 0.1, r)], [r, r], 14)
            for at, r in ((front, front_radius), (rear, rear_radius))
            for s in (-1, 1)
        ]
    )
