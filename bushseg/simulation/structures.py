"""What people built or brought: house, wall, fence, lamp post, car, and the people themselves."""

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import (
    CLOTH,
    GLASS,
    METAL,
    PAINT,
    PLASTER,
    RUBBER,
    SKIN,
    STONE,
    TILES,
    WOOD,
)
from bushseg.simulation.mesh import (
    Mesh,
    Model,
    Surface,
    box,
    ellipsoid,
    instances,
    join,
    polyhedron,
    tube,
    tubes,
)
from bushseg.simulation.terrain import Terrain

FOOTING = 1.5
"""How far buildings reach below their origin, metres, so that they stand on a slope."""


def house(length: float, width: float, eaves: float) -> Model:
    """A house with a gable roof along x; `length`, `width` and height of the `eaves` in metres."""
    x, y, ridge = length / 2, width / 2, eaves + 0.45 * width
    walls = polyhedron(
        [
            *[(sx * x, sy * y, z) for z in (-FOOTING, eaves) for sx in (-1, 1) for sy in (-1, 1)],
            (-x, 0, ridge),
            (x, 0, ridge),
        ],
        [(0, 1, 5, 8, 4), (2, 3, 7, 9, 6), (0, 2, 6, 4), (1, 3, 7, 5)],
    )
    openings = [
        box((at - 0.5, side * y - 0.03, 1.0), (at + 0.5, side * y + 0.03, 2.2))
        for side in (-1, 1)
        for at in np.linspace(-0.3, 0.3, 3) * length
        if (side, at) != (-1, 0.0)
    ]
    door = box((-0.5, -y - 0.04, -FOOTING), (0.5, -y + 0.02, 2.1))
    chimney = box((0.2 * length, -0.3, eaves), (0.2 * length + 0.6, 0.3, ridge + 0.7))
    return [
        Surface(walls, PLASTER),
        Surface(join([_slab(x, y, eaves, ridge, side) for side in (-1, 1)]), TILES),
        Surface(join(openings), GLASS),
        Surface(door, WOOD),
        Surface(chimney, STONE),
    ]


def _slab(x: float, y: float, eaves: float, ridge: float, side: int) -> Mesh:
    """One half of a gable roof, 0.2 m thick, overhanging by 0.4 m on all sides but the ridge."""
    over, thick = 0.4, 0.2
    low = eaves - over * (ridge - eaves) / y
    bottom = [
        (s * (x + over), t, z) for s in (-1, 1) for t, z in ((0, ridge), (side * (y + over), low))
    ]
    top = [(px, py, pz + thick) for px, py, pz in bottom]
    faces = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (1, 3, 7, 5)]
    return polyhedron([*bottom, *top], faces)


def wall(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """A stone wall with a coping, stepped along the ground from `start` to `end` (2,), metres."""
    num_steps = max(round(float(np.linalg.norm(end - start)) / 2), 1)
    length = float(np.linalg.norm(end - start)) / num_steps
    stone = box((-length / 2, -0.15, -0.6), (length / 2, 0.15, height))
    coping = box((-length / 2, -0.2, height), (length / 2, 0.2, height + 0.08))
    where = _places(terrain, start, end, (np.arange(num_steps) + 0.5) / num_steps)
    turns = _facing(start, end, num_steps)
    return [Surface(instances(join([stone, coping]), where, turns), STONE)]


def fence(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """A picket fence that follows the ground from `start` to `end` (2,), metres."""
    length = float(np.linalg.norm(end - start))
    num_bays, num_pickets = max(round(length / 2), 1), round(length / 0.14)
    posts = _places(terrain, start, end, np.linspace(0, 1, num_bays + 1))
    pickets = _places(terrain, start, end, (np.arange(num_pickets) + 0.5) / num_pickets)
    post = box((-0.05, -0.05, -0.3), (0.05, 0.05, height + 0.1))
    picket = box((-0.04, 0.04, 0.06), (0.04, 0.06, height))
    rails = [
        tubes(np.stack([lifted[:-1], lifted[1:]], axis=1), np.full((num_bays, 2), 0.035), sides=4)
        for lifted in (posts + np.array([0, 0, share * height]) for share in (0.3, 0.8))
    ]
    boards = [
        instances(mesh, where, _facing(start, end, len(where)))
        for mesh, where in ((post, posts), (picket, pickets))
    ]
    return [Surface(join([*boards, *rails]), WOOD)]


def _places(terrain: Terrain, start: FloatArray, end: FloatArray, t: FloatArray) -> FloatArray:
    """Places on the ground at shares `t` (N,) of the way; (N, 3)."""
    xy = start + t[:, None] * (end - start)
    return np.column_stack([xy, terrain.height(xy)])


def _facing(start: FloatArray, end: FloatArray, number: int) -> FloatArray:
    """`number` rotations that turn x along the way from `start` to `end`; (N, 3, 3)."""
    cos, sin = (end - start) / np.linalg.norm(end - start)
    return np.broadcast_to([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], (number, 3, 3))


def lamp_post(height: float) -> Model:
    """A lamp post of `height` metres with an arm along x."""
    post = tube([(0, 0, -0.3), (0, 0, height)], [0.08, 0.05], sides=10)
    arm = tube([(0, 0, height - 0.1), (1.1, 0, height + 0.1)], [0.035, 0.03])
    lamp = box((0.9, -0.15, height + 0.02), (1.5, 0.15, height + 0.14))
    return [Surface(join([post, arm, lamp]), METAL)]


def car(rng: np.random.Generator) -> Model:
    """A car along x, about 4.3 m long."""
    x, y = 2.15 * rng.uniform(0.95, 1.08), 0.88
    body = polyhedron(
        [(sx * x, sy * y, z) for z in (0.25, 0.85) for sx in (-1, 1) for sy in (-1, 1)],
        [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)],
    )
    roof = 1.45 * rng.uniform(0.97, 1.15)
    rings = [(-0.85 * x, 0.45 * x, y - 0.04, 0.85), (-0.6 * x, 0.12 * x, y - 0.2, roof)]
    cabin = polyhedron(
        [
            (px, side * py, z)
            for rear, front, py, z in rings
            for px in (rear, front)
            for side in (-1, 1)
        ],
        [(4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)],
    )
    lid = box((-0.58 * x, 0.22 - y, roof), (0.1 * x, y - 0.22, roof + 0.03))
    wheels = [
        tube([(at * x, side * y - 0.1, 0.31), (at * x, side * y + 0.1, 0.31)], [0.31, 0.31], 14)
        for at in (-0.62, 0.62)
        for side in (-1, 1)
    ]
    paint = PAINT[rng.integers(len(PAINT))]
    return [
        Surface(join([body, lid]), paint),
        Surface(cabin, GLASS),
        Surface(join(wheels), RUBBER),
    ]


def person(rng: np.random.Generator) -> Model:
    """A person 1.55 to 1.9 m tall, facing x."""
    tall = rng.uniform(1.55, 1.9)
    stride = rng.uniform(0.05, 0.25)
    legs = [
        tube([(side * stride, side * 0.11, 0), (0, side * 0.09, 0.5 * tall)], [0.06, 0.085], 8)
        for side in (-1, 1)
    ]
    arms = [
        tube(
            [(0, side * 0.22, 0.8 * tall), (-side * stride, side * 0.27, 0.46 * tall)],
            [0.05, 0.04],
            8,
        )
        for side in (-1, 1)
    ]
    torso = ellipsoid((0, 0, 0.66 * tall), (0.14, 0.22, 0.2 * tall))
    head = ellipsoid((0.02, 0, 0.93 * tall), (0.1, 0.09, 0.07 * tall))
    shirt, trousers = rng.choice(len(CLOTH), size=2)
    return [
        Surface(join([torso, *arms]), CLOTH[shirt]),
        Surface(join(legs), CLOTH[trousers]),
        Surface(head, SKIN),
    ]
