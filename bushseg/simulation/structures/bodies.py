"""Bodies of cars and vans: lofted from a side view, glass left out as the laser mostly finds it."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from bushseg.points import FloatArray
from bushseg.simulation.materials import CLOTH, GLASS, PAINT, RUBBER
from bushseg.simulation.mesh import Mesh, Model, Surface, box, ellipsoid, join, tube

BodyKind = Literal["hatchback", "saloon", "estate", "suv", "minivan", "pickup", "van"]
BODY_KINDS: tuple[BodyKind, ...] = get_args(BodyKind)


@dataclass(frozen=True, slots=True)
class Body:
    """How a kind of car is shaped.

    Attributes:
        size: Length, width and height, metres.
        outline: Where the upper outline has its knots, from the tail (-1) to the nose (1).
        tops: Its height at each of them, over the car's own.
        belt: Where windows begin, over the height.
        pillars: Where the roof is carried, from tail to nose; windows lie between them.
        clearance: Height of the underbody, metres.
    """

    size: tuple[float, float, float]
    outline: tuple[float, ...]
    tops: tuple[float, ...]
    belt: float
    pillars: tuple[float, ...]
    clearance: float = 0.2


BODIES: dict[BodyKind, Body] = {
    "hatchback": Body(
        (4.0, 1.76, 1.48),
        (-1, -0.97, -0.91, -0.77, -0.5, -0.1, 0.12, 0.44, 0.72, 0.93, 1),
        (0.4, 0.6, 0.66, 0.93, 0.99, 1, 0.95, 0.65, 0.58, 0.48, 0.34),
        0.63,
        (-0.72, -0.3, 0.02, 0.34),
    ),
    "saloon": Body(
        (4.6, 1.82, 1.45),
        (-1, -0.98, -0.66, -0.4, -0.18, 0, 0.14, 0.42, 0.72, 0.95, 1),
        (0.4, 0.62, 0.67, 0.93, 0.99, 1, 0.94, 0.64, 0.57, 0.46, 0.33),
        0.64,
        (-0.5, -0.12, 0.1, 0.34),
    ),
    "estate": Body(
        (4.6, 1.82, 1.49),
        (-1, -0.98, -0.95, -0.85, -0.68, -0.2, 0.08, 0.38, 0.7, 0.94, 1),
        (0.4, 0.6, 0.66, 0.93, 0.98, 1, 0.95, 0.64, 0.57, 0.46, 0.33),
        0.63,
        (-0.82, -0.45, -0.12, 0.28),
    ),
    "suv": Body(
        (4.5, 1.86, 1.68),
        (-1, -0.97, -0.93, -0.83, -0.6, -0.1, 0.12, 0.4, 0.75, 0.95, 1),
        (0.42, 0.62, 0.67, 0.94, 1, 1, 0.95, 0.68, 0.63, 0.53, 0.37),
        0.65,
        (-0.78, -0.35, 0.0, 0.32),
        0.26,
    ),
    "minivan": Body(
        (4.4, 1.82, 1.75),
        (-1, -0.985, -0.95, -0.89, -0.7, -0.1, 0.25, 0.64, 0.86, 1),
        (0.32, 0.55, 0.62, 0.93, 0.99, 1, 0.94, 0.6, 0.5, 0.32),
        0.6,
        (-0.86, -0.35, 0.1, 0.5),
    ),
    "pickup": Body(
        (5.2, 1.88, 1.78),
        (-1, -0.99, -0.32, -0.24, -0.08, 0.1, 0.22, 0.43, 0.8, 0.96, 1),
        (0.36, 0.54, 0.55, 0.9, 1, 1, 0.95, 0.65, 0.6, 0.51, 0.35),
        0.64,
        (-0.24, 0.02, 0.35),
        0.3,
    ),
    "van": Body(
        (5.4, 1.98, 2.35),
        (-1, -0.995, -0.97, -0.85, 0.1, 0.42, 0.55, 0.78, 0.94, 1),
        (0.2, 0.88, 0.97, 1, 1, 0.97, 0.86, 0.53, 0.46, 0.22),
        0.53,
        (0.22, 0.6),
        0.3,
    ),
}
"""Bodies by name, as they are on European roads."""

WHEEL_RADIUS = 0.19
"""Of a car, over its height."""

TINTED = 0.2
"""Share of cars whose panes send the laser back; through others it sees the seats."""


def body_car(rng: np.random.Generator, kind: BodyKind, scale: float = 1.0) -> Model:
    """Draw a car or van along x, its nose ahead, standing on its wheels.

    Args:
        rng: Source of randomness.
        kind: Its body.
        scale: Factor on its length; width and height follow by half.
    """
    form = BODIES[kind]
    grown = scale * rng.uniform(0.97, 1.03), (1 + scale) / 2, (1 + scale) / 2
    long, wide, high = np.array(form.size) * grown * (1, 1, rng.uniform(0.97, 1.05))
    x, y = long / 2, wide / 2
    radius = min(WHEEL_RADIUS * high, 0.37) * rng.uniform(0.95, 1.08)
    axles = (-0.58 * x + rng.normal(0, 0.04), 0.62 * x + rng.normal(0, 0.04))
    shell, panes = _shell(form, x, y, high, radius, axles)
    paint = PAINT[rng.integers(len(PAINT))]
    model = [
        Surface(join([shell, *_mirrors(form, x, y, high)]), paint),
        Surface(wheels(axles[1], axles[0], y, radius, radius), RUBBER),
        Surface(_seats(form, x, y, high), CLOTH[rng.integers(len(CLOTH))]),
    ]
    if rng.random() < TINTED:
        model.append(Surface(panes, GLASS))
    return model


def _shell(
    form: Body, x: float, y: float, high: float, radius: float, axles: tuple[float, float]
) -> tuple[Mesh, Mesh]:
    """The painted panels and the panes, between stations along the car."""
    knots, heights = form.outline, form.tops
    arch = 1.25 * radius
    at = [*knots, *np.linspace(-0.99, 0.99, 16)]
    at += [p + d for p in form.pillars for d in (-0.02, 0.02)]
    at += [
        (axle + d * arch) / x for axle in axles for d in (-1.01, -0.99, -0.7, 0, 0.7, 0.99, 1.01)
    ]
    shares = np.unique(np.round(np.clip(at, -1, 1), 3))
    top = high * PchipInterpolator(knots, heights)(shares)
    belt = np.minimum(form.belt * high, top - 0.02)
    half = y * (1 - 0.16 * np.abs(shares) ** 5)  # rounded corners seen from above
    low = form.clearance + 0.12 * np.abs(shares) ** 6
    off = np.min([np.abs(shares * x - axle) for axle in axles], axis=0)
    sill = np.maximum(
        low + 0.03, np.where(off < arch, radius + np.sqrt(np.maximum(arch**2 - off**2, 0)), 0)
    )
    sill = np.minimum(sill, belt - 0.08)
    lean = np.clip((top - belt) / high, 0, 0.5)
    shoulder = half * (0.97 - 0.42 * lean)
    rows = [
        (0 * half, low),
        (0.86 * half, low),
        (0.97 * half, sill),
        (half, np.maximum(0.45 * (sill + belt), sill + 0.02)),
        (0.97 * half, belt),
        (shoulder, np.maximum(top - 0.07, belt + 0.01)),
        (0.8 * shoulder, top),
        (0 * half, top + 0.02),
    ]
    section = np.stack([np.stack([shares * x, w, z], axis=-1) for w, z in rows], axis=1)
    glazed = _glazed(form, shares, top, high)
    sides = [section, section * (1, -1, 1)]
    ends = [_fan(side[end]) for side in sides for end in (0, -1)]
    return join([*(_loft(side, ~glazed) for side in sides), *ends]), join(
        [_loft(side, glazed) for side in sides]
    )


def _glazed(form: Body, shares: FloatArray, top: FloatArray, high: float) -> NDArray[np.bool_]:
    """Which quads of a half are panes: (stations - 1, rows - 1), bool."""
    middle = (shares[1:] + shares[:-1]) / 2
    height = (top[1:] + top[:-1]) / 2 / high
    slope = np.abs(np.diff(top)) / np.maximum(np.diff(shares), 1e-6) / high
    pillar = np.min([np.abs(middle - p) for p in form.pillars], axis=0) < 0.021
    between = (middle > form.pillars[0]) & (middle < form.pillars[-1])
    glazed = np.zeros((len(middle), 7), bool)
    glazed[:, 4] = between & ~pillar & (height > form.belt + 0.12)
    screen = (slope > 0.45) & (height > form.belt + 0.04) & (height < 0.95)
    glazed[:, 6] = screen & ((middle > 0) | (form.pillars[0] < 0))
    return glazed


def _loft(section: FloatArray, kept: NDArray[np.bool_]) -> Mesh:
    """Quads between neighboring stations of (S, R, 3), those of `kept` (S - 1, R - 1)."""
    number, rows, _ = section.shape
    i, j = np.nonzero(kept)
    a = i * rows + j
    b, c, d = a + 1, a + rows, a + rows + 1
    return Mesh.of(
        section.reshape(number * rows, 3),
        np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)]),
    )


def _fan(ring: FloatArray) -> Mesh:
    """Close an end: a fan over the points of one station (R, 3)."""
    number = len(ring)
    last = np.arange(1, number - 1)
    return Mesh.of(ring, np.stack([np.zeros_like(last), last, last + 1], axis=1))


def _mirrors(form: Body, x: float, y: float, high: float) -> list[Mesh]:
    """Two wing mirrors before the foremost pillar."""
    at, z = form.pillars[-1] * x, form.belt * high
    return [
        box((at, s * (y + 0.06) - 0.09, z), (at + 0.09, s * (y + 0.06) + 0.09, z + 0.14))
        for s in (-1, 1)
    ]


def _seats(form: Body, x: float, y: float, high: float) -> Mesh:
    """Backs of seats and the dashboard, which are seen through the windows."""
    rows = [p - 0.14 for p in form.pillars[1:]] if len(form.pillars) > 2 else [0.25]
    backs = [
        ellipsoid((at * x, s * 0.42 * y, 0.55 * high), (0.14, 0.24, 0.3 * high * 0.9), sides=7)
        for at in rows
        for s in (-1, 1)
    ]
    dash = form.pillars[-1] * x
    board = box(
        (dash - 0.1, -0.75 * y, 0.4 * high), (dash + 0.12, 0.75 * y, form.belt * high - 0.03)
    )
    return join([*backs, board])


def wheels(front: float, rear: float, y: float, front_radius: float, rear_radius: float) -> Mesh:
    """Four wheels of the given radii, their axles at `front` and `rear`, metres."""
    return join(
        [
            tube([(at, s * (y - 0.2), r), (at, s * (y - 0.01), r)], [r, r], 14)
            for at, r in ((front, front_radius), (rear, rear_radius))
            for s in (-1, 1)
        ]
    )
