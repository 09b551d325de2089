"""Walls, fences and guard rails, which follow the ground along a line."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import CONCRETE, METAL, STONE, WOOD
from bushseg.simulation.mesh import Mesh, Model, Surface, box, instances, join, polyhedron, tubes
from bushseg.simulation.terrain import Terrain

Barrier = Callable[[Terrain, FloatArray, FloatArray, float], Model]


def wall(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """A stone wall with a coping, stepped along the ground from `start` to `end` (2,), metres."""
    num_steps = max(round(float(np.linalg.norm(end - start)) / 2), 1)
    length = float(np.linalg.norm(end - start)) / num_steps
    stone = box((-length / 2, -0.15, -0.6), (length / 2, 0.15, height))
    coping = box((-length / 2, -0.2, height), (length / 2, 0.2, height + 0.08))
    where = _places(terrain, start, end, (np.arange(num_steps) + 0.5) / num_steps)
    turns = _facing(start, end, num_steps)
    return [Surface(instances(join([stone, coping]), where, turns), STONE)]


def picket_fence(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """Pickets of 8 cm, 6 cm apart, on two rails."""
    return _boards(terrain, start, end, height, pitch=0.14, width=0.08)


def board_fence(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """Upright boards without gaps."""
    return _boards(terrain, start, end, height, pitch=0.2, width=0.2)


def _boards(
    terrain: Terrain,
    start: FloatArray,
    end: FloatArray,
    height: float,
    *,
    pitch: float,
    width: float,
) -> Model:
    """Boards of `width` every `pitch` metres, on posts and two rails."""
    length = float(np.linalg.norm(end - start))
    num_bays, num_boards = max(round(length / 2), 1), max(round(length / pitch), 1)
    posts = _places(terrain, start, end, np.linspace(0, 1, num_bays + 1))
    boards = _places(terrain, start, end, (np.arange(num_boards) + 0.5) / num_boards)
    post = box((-0.05, -0.05, -0.3), (0.05, 0.05, height + 0.1))
    board = box((-width / 2, 0.04, 0.06), (width / 2, 0.06, height))
    upright = [
        instances(mesh, where, _facing(start, end, len(where)))
        for mesh, where in ((post, posts), (board, boards))
    ]
    return [Surface(join([*upright, *_rails(posts, (0.3 * height, 0.8 * height), 0.035)]), WOOD)]


def wire_fence(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """Wooden posts every 3 m with five wires: nearly invisible, but for the posts."""
    length = float(np.linalg.norm(end - start))
    posts = _places(terrain, start, end, np.linspace(0, 1, max(round(length / 3), 1) + 1))
    post = box((-0.05, -0.05, -0.3), (0.05, 0.05, height + 0.08))
    wires = join(_rails(posts, np.linspace(0.15, 1, 5) * height, 0.0025, sides=3))
    stakes = instances(post, posts, _facing(start, end, len(posts)))
    return [Surface(stakes, WOOD), Surface(wires, METAL)]


def mesh_fence(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """Steel posts with a welded mesh of 5 cm by 20 cm, as yards have."""
    length = float(np.linalg.norm(end - start))
    posts = _places(terrain, start, end, np.linspace(0, 1, max(round(length / 2.5), 1) + 1))
    bars = _places(terrain, start, end, np.linspace(0, 1, max(round(length / 0.05), 2)))
    bar = polyhedron([(-0.003, 0, 0.05), (0.003, 0, 0.05), (0, 0, height)], [(0, 1, 2)])
    post = box((-0.03, -0.03, -0.3), (0.03, 0.03, height))
    steel = [
        instances(mesh, where, _facing(start, end, len(where)))
        for mesh, where in ((post, posts), (bar, bars))
    ]
    rails = _rails(posts, np.arange(0.1, height, 0.2), 0.003, sides=3)
    return [Surface(join([*steel, *rails]), METAL)]


def guard_rail(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """A road's W-beam on posts every 2 m; `height` is its upper edge's."""
    length = float(np.linalg.norm(end - start))
    posts = _places(terrain, start, end, np.linspace(0, 1, max(round(length / 2), 1) + 1))
    post = box((-0.03, -0.06, -0.3), (0.03, 0.06, height - 0.05))
    beam = [
        polyhedron(
            [
                (*a[:2], a[2] + low),
                (*b[:2], b[2] + low),
                (*b[:2], b[2] + high),
                (*a[:2], a[2] + high),
            ],
            [(0, 1, 2, 3)],
        )
        for a, b in pairwise(posts)
        for low, high in ((height - 0.31, height - 0.17), (height - 0.14, height))
    ]
    stakes = instances(post, posts, _facing(start, end, len(posts)))
    return [Surface(join([stakes, *beam]), METAL)]


def kerb_wall(terrain: Terrain, start: FloatArray, end: FloatArray, height: float) -> Model:
    """A plain concrete wall, for yards and cellars."""
    (surface,) = wall(terrain, start, end, height)
    return [Surface(surface.mesh, CONCRETE)]


BARRIERS: dict[str, Barrier] = {
    "wall": wall,
    "concrete": kerb_wall,
    "picket": picket_fence,
    "boards": board_fence,
    "wire": wire_fence,
    "mesh": mesh_fence,
    "guard rail": guard_rail,
}


def _rails(
    posts: FloatArray, heights: FloatArray | tuple[float, ...], radius: float, sides: int = 4
) -> list[Mesh]:
    """Rods from post to post (N, 3) at each of `heights`."""
    number = len(posts) - 1
    lifted = (posts + np.array([0, 0, height]) for height in heights)
    return [
        tubes(np.stack([at[:-1], at[1:]], axis=1), np.full((number, 2), radius), sides=sides)
        for at in lifted
    ]


def _places(terrain: Terrain, start: FloatArray, end: FloatArray, t: FloatArray) -> FloatArray:
    """Places on the ground at shares `t` (N,) of the way; (N, 3)."""
    xy = start + t[:, None] * (end - start)
    return np.column_stack([xy, terrain.height(xy)])


def _facing(start: FloatArray, end: FloatArray, number: int) -> FloatArray:
    """`number` rotations that turn x along the way from `start` to `end`; (N, 3, 3)."""
    cos, sin = (end - start) / np.linalg.norm(end - start)
    return np.broadcast_to([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]], (number, 3, 3))
