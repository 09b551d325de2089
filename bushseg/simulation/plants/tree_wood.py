"""The wood of a tree, from the roots to the twigs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.plants.branches import (
    UP,
    Branches,
    fitting,
    growing,
    reaching,
    sprouting,
    tilted,
)
from bushseg.simulation.plants.crowns import within
from bushseg.simulation.plants.tree_forms import Form

TRUNK_KNOTS = 14
BREAST_HEIGHT = 1.3
WHORL = 6
"""Boughs of a whorl of a conifer."""


@dataclass(frozen=True, slots=True)
class TreeSize:
    """A tree's measures, metres.

    Attributes:
        height: From the ground to the top.
        half: Half the crown's diameter.
        base: Where the crown begins.
        thick: Half the stem's diameter at breast height.
    """

    height: float
    half: float
    base: float
    thick: float


@dataclass(frozen=True, slots=True)
class TreeWood:
    """Stems, boughs on stems, branches on boughs, twigs on branches and boughs."""

    stems: Branches
    boughs: Branches
    branches: Branches
    twigs: Branches


def tree_wood(rng: np.random.Generator, build: Form, size: TreeSize, detail: float) -> TreeWood:
    """Grow a tree's wood.

    Args:
        rng: Source of randomness.
        build: Its form.
        size: Its measures.
        detail: Factor on the number of twigs.
    """
    stems = _stems(rng, build, size)
    boughs = _boughs(rng, build, size, stems)
    ten = size.height / 10  # twigs of small trees are shorter, but not by as much
    branches = sprouting(
        rng,
        boughs,
        int(np.clip(220 * ten**0.5 * build.boughs / 34, 60, 600)),
        start=0.25,
        angle=(50, 12),
        length=0.42,
        thickness=0.6,
        knots=4,
        rise=max(build.droop, -0.5),
    )
    hanging = build.droop < -1
    twigs = sprouting(
        rng,
        branches,
        int(np.clip(1300 * ten**0.6 * detail, 150, 6000)) // (3 if hanging else 1),
        start=0.2 if build.clumping > 0.6 else 0.55,
        angle=(45, 15),
        length=(build.twig[0] * ten**0.5, build.twig[1] * ten**0.5),
        knots=5 if hanging else 2,
        rise=build.droop,
    )
    branches = _with_stubs(rng, stems, branches, size)
    factors = fitting(twigs, size.half, 0.98 * size.height)
    return TreeWood(
        stems.scaled(factors),
        boughs.scaled(factors),
        _above_ground(branches.scaled(factors)),
        _above_ground(twigs.scaled(factors)),
    )


def _with_stubs(
    rng: np.random.Generator, stems: Branches, branches: Branches, size: TreeSize
) -> Branches:
    """Add to the branches what is left of dead boughs below the crown."""
    number = int(rng.integers(0, 3 + int(4 * size.base)))
    if not number:
        return branches
    stubs = sprouting(
        rng,
        stems,
        number,
        start=0.05,
        angle=(75, 15),
        length=(0.1, 0.2 + 0.06 * size.height),
        thickness=0.15,
        knots=4,
    )
    low = stubs.paths[:, 0, 2] < size.base
    return Branches(
        np.concatenate([branches.paths, stubs.paths[low]]),
        np.concatenate([branches.radii, stubs.radii[low]]),
    )


def _stems(rng: np.random.Generator, build: Form, size: TreeSize) -> Branches:
    """Stems that taper to nothing at the top and swell at the foot."""
    number = int(rng.integers(build.stems[0], build.stems[1] + 1))
    around = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(number) / number
    out = np.stack([np.cos(around), np.sin(around), np.zeros(number)], axis=1)
    lone = number == 1
    lean = (
        np.abs(rng.normal(0, 1 if build.needles else 3, 1)) if lone else rng.uniform(5, 16, number)
    )
    headings = tilted(rng, np.tile(UP, (number, 1)), lean) if lone else _leaning(out, lean)
    feet = (0.0 if lone else 1.6) * size.thick * out - 0.25 * UP
    lengths = (size.height * build.trunk + 0.25) * (1 if lone else rng.uniform(0.75, 1.0, number))
    curves = growing(
        rng,
        feet,
        headings,
        np.broadcast_to(lengths, number).astype(np.float64),
        np.ones(number),
        knots=TRUNK_KNOTS,
        rise=0.12 if lone else 0.25,
        wiggle=0.012 if build.needles else 0.025,
    )
    z = np.maximum(curves.paths[:, :, 2], 0.0)
    # Taper is nearly linear above breast height (Kozak, simplified); roots swell the foot.
    left = np.clip((size.height - z) / max(size.height - BREAST_HEIGHT, 0.5), 0.04, 1.3)
    swell = 1 + rng.uniform(0.2, 0.7) * np.exp(-z / (0.15 + 2 * size.thick))
    radii = size.thick * left**0.9 * swell / np.sqrt(number)
    return Branches(curves.paths, np.maximum(radii, 0.003))


def _leaning(out: FloatArray, lean: FloatArray) -> FloatArray:
    """Unit vectors (N, 3) that lean by `lean` (N,) degrees towards `out` (N, 3)."""
    angle = np.radians(lean)[:, None]
    return np.cos(angle) * UP + np.sin(angle) * out


def _boughs(rng: np.random.Generator, build: Form, size: TreeSize, stems: Branches) -> Branches:
    """Boughs from the stems to places in the crown."""
    crown = size.height - size.base
    long = crown / (0.7 * size.height)
    number = int(np.clip(build.boughs * (size.height / 10) ** 0.4 * long, 14, 140))
    power = 0.8 if build.needles else 1.3
    tips = within(rng, np.array(build.profile), number, filling=build.filling, power=power)
    if build.needles:
        whorls = max(number // WHORL, 4)
        tips[:, 2] = (np.floor(tips[:, 2] * whorls) + 0.5 + rng.normal(0, 0.12, number)) / whorls
    share = np.clip(tips[:, 2], 0, 1)
    tips = tips * (size.half, size.half, crown)
    slopes = build.slopes[0] + (build.slopes[1] - build.slopes[0]) * share
    slopes = np.radians(slopes + rng.normal(0, 6, number))

    index = _nearest_stem(rng, stems, tips)
    tips[:, 2] += size.base
    out = np.hypot(tips[:, 0], tips[:, 1])
    feet_z = tips[:, 2] - out * np.tan(slopes)
    lowest = max(0.85 * size.base, 0.1)
    tops = stems.paths[index, -1, 2]
    t = np.clip(feet_z, lowest, 0.97 * tops)
    t = np.clip((t + 0.25) / (tops + 0.25), 0.02, 0.98)
    feet, _, radii = stems.at(index, t)
    # The crown follows its stem where that leans.
    tips[:, :2] += feet[:, :2] * (0.3 if len(stems) > 1 else 0.9)
    tips[:, 2] = np.maximum(tips[:, 2], 0.06)
    reach = np.linalg.norm(tips - feet, axis=1)
    bends = feet + 0.5 * (tips - feet) + (0.12 * reach * np.sign(slopes))[:, None] * UP
    thick = np.minimum(rng.uniform(0.3, 0.55, number) * radii, 0.022 * reach + 0.003)
    return reaching(feet, bends, tips, thick, 5)


def _nearest_stem(rng: np.random.Generator, stems: Branches, tips: FloatArray) -> NDArray[np.intp]:
    """Which stem bears each of `tips` (N, 3): one that leans its way."""
    ends = stems.paths[:, -1, :2]
    distance = np.linalg.norm(tips[:, None, :2] - ends[None], axis=2)
    nearest: NDArray[np.intp] = (distance * rng.uniform(0.7, 1.3, distance.shape)).argmin(axis=1)
    return nearest


def _above_ground(branches: Branches) -> Branches:
    """Lift what would hang into the ground."""
    paths = branches.paths.copy()
    paths[:, :, 2] = np.maximum(paths[:, :, 2], 0.03)
    return Branches(paths, branches.radii)
