"""What drives: cars and vans of all bodies, tractors, bicycles; along x."""

from collections.abc import Callable
from functools import partial

import numpy as np

from bushseg.simulation.materials import METAL, PAINT, RUBBER
from bushseg.simulation.mesh import Model, Surface, box, join, tube, tubes
from bushseg.simulation.structures.bodies import BODY_KINDS, BodyKind, body_car, wheels


def tractor(rng: np.random.Generator, scale: float = 1.0) -> Model:
    """A tractor, about 4 m long, large wheels behind."""
    x, y = scale * rng.uniform(1.8, 2.2), 0.95
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
        Surface(wheels(0.75 * x, -0.55 * x, y + 0.1, 0.45, 0.8), RUBBER),
    ]


def _of_body(kind: BodyKind, rng: np.random.Generator, scale: float = 1.0) -> Model:
    """A car or van of that body."""
    return body_car(rng, kind, scale)


def bicycle(rng: np.random.Generator) -> Model:
    """A bicycle, about 1.75 m long, standing upright."""
    r, half = rng.uniform(0.31, 0.36), rng.uniform(0.48, 0.55)
    turn = np.linspace(0, 2 * np.pi, 17)
    rings = np.stack(
        [
            np.stack([at + r * np.cos(turn), 0 * turn, r + 0.02 + r * np.sin(turn)], axis=1)
            for at in (-half, half)
        ]
    )
    saddle, head, crank = (-0.25, 0.0, 0.85), (0.36, 0.0, 0.9), (-0.05, 0.0, 0.3)
    rods = [
        (saddle, crank),
        (crank, head),
        (saddle, head),
        (saddle, (-half, 0.0, r)),
        ((-half, 0.0, r), crank),
    ]
    rods += [
        (head, (half, 0.0, r)),
        ((0.36, -0.3, 1.02), (0.36, 0.3, 1.02)),
        (head, (0.36, 0.0, 1.02)),
    ]
    paths = np.array(rods, np.float64)
    frame = tubes(paths, np.full(paths.shape[:2], 0.018), sides=5)
    seat = box((-0.38, -0.07, 0.85), (-0.14, 0.07, 0.92))
    return [
        Surface(join([frame, seat]), PAINT[rng.integers(len(PAINT))]),
        Surface(tubes(rings, np.full(rings.shape[:2], 0.018), sides=5), RUBBER),
    ]


VEHICLES: dict[str, Callable[[np.random.Generator, float], Model]] = {
    **{kind: partial(_of_body, kind) for kind in BODY_KINDS},
    "tractor": tractor,
}
"""Vehicles by name: drawn from a generator and a factor on their length."""
