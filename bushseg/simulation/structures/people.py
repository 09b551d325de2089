"""People, standing or walking."""

import numpy as np

from bushseg.simulation.materials import CLOTH, SKIN
from bushseg.simulation.mesh import Model, Surface, ellipsoid, join, tube


def person(rng: np.random.Generator) -> Model:
    """A person 1.2 to 1.95 m tall, facing x; the stride tells standing from walking."""
    tall = float(np.clip(rng.normal(1.7, 0.12), 1.2, 1.95))
    stride = rng.uniform(0.02, 0.06) if rng.random() < 0.5 else rng.uniform(0.15, 0.35)
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
