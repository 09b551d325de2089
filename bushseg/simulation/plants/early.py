"""Bushes and trees: an envelope filled with sprigs, and wood that reaches into it."""

from typing import Literal, get_args

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.foliage import foliage, leaf_area
from bushseg.simulation.materials import BARK, BROADLEAF, NEEDLES, SHRUB_LEAF
from bushseg.simulation.mesh import Mesh, Model, Surface, join, tube, tubes

Habit = Literal["mound", "columnar", "multi-stemmed", "hedge"]
Form = Literal["broadleaf", "conifer"]
HABITS: tuple[Habit, ...] = get_args(Habit)

MAX_SPRIGS = 2000


def bush(rng: np.random.Generator, habit: Habit, height: float, width: float) -> Model:
    """Grow a bush.

    Args:
        rng: Source of randomness.
        habit: How it grows; a hedge runs along x, its length being `width`.
        height: Its height, metres.
        width: Its spread (a hedge's length), metres.
    """
    depth = np.clip(0.6 * height, 0.5, 1.0) if habit == "hedge" else width
    extent = np.array([width / 2, depth / 2, height])
    surface = 2 * height * (width + depth) + width * depth
    sprig = str(rng.choice(["broad", "small", "narrow"]))
    cover = rng.uniform(0.8, 1.5)
    num_sprigs, scale = _density(cover * surface, sprig)
    leaves = _envelope(rng, habit, num_sprigs) * extent
    leaves[:, 2] = np.maximum(leaves[:, 2], 0.04)
    wood = _stems(rng, leaves, extent, habit)
    material = SHRUB_LEAF[rng.integers(len(SHRUB_LEAF))]
    return [Surface(foliage(rng, sprig, leaves, scale), material), Surface(wood, BARK)]


def tree(
    rng: np.random.Generator, form: Form, height: float, width: float, crown_base: float
) -> Model:
    """Grow a tree.

    Args:
        rng: Source of randomness.
        form: Its kind.
        height: Its height, metres.
        width: The crown's diameter, metres.
        crown_base: Height at which the crown begins, metres.
    """
    trunk = _trunk(rng, height, reach=1.0 if form == "conifer" else 0.8)
    ends, starts = _boughs(rng, form, height, width, crown_base)
    feet = _along(trunk, starts)
    tips = _along(trunk, ends[:, 2]) * (1, 1, 0) + ends
    radius = 0.012 * height + 0.03
    stem = tube(trunk, radius * np.linspace(1, 0.25, len(trunk)), sides=9)
    boughs = _rods(feet, tips, radius * rng.uniform(0.15, 0.3, len(tips)))

    conifer = form == "conifer"
    sprig = "needle" if conifer else str(rng.choice(["broad", "narrow"]))
    crown = np.pi * width * (height - crown_base)
    num_sprigs, scale = _density((2.2 if conifer else 1.5) * crown, sprig, least=1.8)
    on = rng.integers(len(tips), size=num_sprigs)
    t = rng.uniform(0.15 if conifer else 0.65, 1.05, (num_sprigs, 1))
    reach = np.linalg.norm(tips - feet, axis=1, keepdims=True)[on]
    spread = 0.12 * reach if conifer else 0.085 * width
    leaves = feet[on] + t * (tips - feet)[on] + spread * rng.standard_normal((num_sprigs, 3))
    leaves[:, 2] = np.maximum(leaves[:, 2], 0.1)
    kinds = NEEDLES if conifer else BROADLEAF
    material = kinds[rng.integers(len(kinds))]
    return [
        Surface(foliage(rng, sprig, leaves, scale), material),
        Surface(join([stem, boughs]), BARK),
    ]


def _density(area: float, sprig: str, least: float = 1.0) -> tuple[int, float]:
    """How many sprigs cover `area` square metres with leaves, and how much over life-size."""
    wanted = area / (leaf_area(sprig) * least**2)
    number = int(np.clip(wanted, 40, MAX_SPRIGS))
    return number, least * float(np.sqrt(max(wanted / number, 1.0)))


def _envelope(rng: np.random.Generator, habit: Habit, number: int) -> FloatArray:
    """Draw places in a habit's unit shape, x and y in -1..1, z in 0..1; dense near its surface."""
    if habit == "hedge":
        places = rng.uniform(-1, 1, (number, 3))
        nearest = np.abs(places).argmax(axis=1)
        rows = np.arange(number)
        depth = np.abs(rng.normal(0, 0.12, number))
        places[rows, nearest] = np.sign(places[rows, nearest]) * (1 - depth)
        places[:, 2] = (places[:, 2] + 1) / 2
        return places
    directions = rng.standard_normal((number, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # Lobes: a bush is no ball.
    lobes = directions @ rng.normal(0, 3.2, (3, 5)) + rng.uniform(0, 2 * np.pi, 5)
    reach = 0.82 + 0.11 * np.sin(lobes).sum(axis=1) / np.sqrt(2)
    places = directions * (reach * rng.uniform(0, 1, number) ** (1 / 5))[:, None]
    if habit == "mound":
        places[:, 2] = np.abs(places[:, 2])
        return places
    places[:, 2] = (places[:, 2] + 1) / 2
    if habit == "multi-stemmed":
        places[:, :2] *= 0.3 + 0.9 * places[:, 2:]
    return places


def _stems(rng: np.random.Generator, leaves: FloatArray, extent: FloatArray, habit: Habit) -> Mesh:
    """Run stems from the ground to some of `leaves` (N, 3) of a bush of `extent` (3,), metres."""
    ends = leaves[rng.choice(len(leaves), size=min(24, len(leaves)), replace=False)]
    feet = rng.normal(0, 0.12, ends.shape) * extent
    if habit == "hedge":
        feet[:, 0] = ends[:, 0]
    feet[:, 2] = -0.1  # roots a little below the ground, which may slope
    return _rods(feet, ends, np.full(len(ends), 0.006 + 0.008 * extent[2]))


def _rods(feet: FloatArray, tips: FloatArray, radii: FloatArray) -> Mesh:
    """Thinning rods of `radii` (N,) from `feet` to `tips` (N, 3): first they rise, then spread."""
    bends = feet + (tips - feet) * (0.4, 0.4, 0.6)
    return tubes(np.stack([feet, bends, tips], axis=1), radii[:, None] * (1, 0.7, 0.25), sides=5)


def _trunk(rng: np.random.Generator, height: float, reach: float) -> FloatArray:
    """A trunk's axis from just under the ground to `reach` of the height, slightly bent; (8, 3)."""
    z = np.linspace(-0.2, reach * height, 8)
    bends = rng.normal(0, 0.012 * height, (8, 2)).cumsum(axis=0) * 0.5
    return np.column_stack([bends - bends[0], z])


def _along(trunk: FloatArray, z: FloatArray) -> FloatArray:
    """The trunk's axis at heights `z` (N,): places (N, 3)."""
    columns = [np.interp(z, trunk[:, 2], trunk[:, axis]) for axis in (0, 1)]
    return np.column_stack([*columns, np.minimum(z, trunk[-1, 2])])


def _boughs(
    rng: np.random.Generator, form: Form, height: float, width: float, crown_base: float
) -> tuple[FloatArray, FloatArray]:
    """Where boughs end, relative to the trunk's axis (N, 3), and how high they begin (N,)."""
    crown = height - crown_base
    if form == "conifer":
        whorls = np.sort(rng.uniform(0, 1, 14))
        up = np.repeat(np.linspace(0, 0.96, 14) + 0.02 * whorls, 6)
        radius = width / 2 * (1 - up) * rng.uniform(0.75, 1.1, len(up))
        yaw = rng.uniform(0, 2 * np.pi, len(up))
        starts = crown_base + up * crown
        drop = -0.15 * radius
        return np.column_stack([radius * np.cos(yaw), radius * np.sin(yaw), starts + drop]), starts
    ends = _envelope(rng, "columnar", 70) * (width / 2, width / 2, crown) * (1, 1, 0.98)
    ends[:, 2] += crown_base
    out = np.hypot(ends[:, 0], ends[:, 1])
    starts = np.maximum(ends[:, 2] - 0.8 * out - 0.15 * crown, crown_base * 0.85)
    return ends, np.minimum(starts, 0.8 * height)
