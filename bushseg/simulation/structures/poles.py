"""Slim things that stand by ways: lamp posts, signs, markers, and poles with their wires."""

from itertools import pairwise

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import METAL, PAINT, WOOD
from bushseg.simulation.mesh import Model, Surface, box, join, tube, tubes

ARM = 0.8
"""Half the length of a power pole's cross-arm, metres."""


def lamp_post(rng: np.random.Generator) -> Model:
    """A lamp post of 4 to 8 m with an arm along x."""
    height = rng.uniform(4, 8)
    post = tube([(0, 0, -0.3), (0, 0, height)], [0.08, 0.05], sides=10)
    arm = tube([(0, 0, height - 0.1), (1.1, 0, height + 0.1)], [0.035, 0.03])
    lamp = box((0.9, -0.15, height + 0.02), (1.5, 0.15, height + 0.14))
    return [Surface(join([post, arm, lamp]), METAL)]


def sign(rng: np.random.Generator) -> Model:
    """A round, square or wide plate facing x on a post."""
    height, width = rng.uniform(1.6, 2.6), rng.uniform(0.4, 0.9)
    tall = width * rng.choice([0.5, 1.0])
    post = tube([(0, 0, -0.3), (0, 0, height + tall)], [0.03, 0.03])
    if rng.random() < 0.4:
        ends = [(0.03, 0, height + width / 2), (0.05, 0, height + width / 2)]
        plate = tube(ends, [width / 2, width / 2], sides=16)
    else:
        plate = box((0.03, -width / 2, height), (0.05, width / 2, height + tall))
    return [Surface(post, METAL), Surface(plate, PAINT[rng.integers(len(PAINT))])]


def marker(rng: np.random.Generator) -> Model:
    """A delineator or boundary post of about 1 m."""
    height = rng.uniform(0.6, 1.1)
    return [Surface(box((-0.04, -0.06, -0.2), (0.04, 0.06, height)), PAINT[1])]


def power_pole(height: float) -> Model:
    """A wooden pole whose cross-arm runs along y."""
    pole = tube([(0, 0, -0.5), (0, 0, height)], [0.14, 0.09], sides=10)
    arm = box((-0.05, -ARM - 0.1, height - 0.5), (0.05, ARM + 0.1, height - 0.38))
    return [Surface(join([pole, arm]), WOOD)]


def wires(tops: FloatArray, sag: float) -> Model:
    """Three wires that hang from pole to pole.

    Args:
        tops: Where the poles' cross-arms are, metres, shape (N, 3), N at least 2.
        sag: How far the wires hang down between poles, metres.
    """
    t = np.linspace(0, 1, 12)
    lines = []
    for a, b in pairwise(tops):
        along = (b - a)[:2] / np.linalg.norm((b - a)[:2])
        side = np.array([-along[1], along[0], 0.0])
        for offset in (-ARM, 0.0, ARM):
            line = a + t[:, None] * (b - a) + offset * side
            line[:, 2] -= 4 * sag * t * (1 - t)
            lines.append(line)
    paths = np.stack(lines)
    return [Surface(tubes(paths, np.full(paths.shape[:2], 0.008), sides=3), METAL)]
