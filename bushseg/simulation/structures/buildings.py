"""Buildings: houses with gable, flat and shed roofs, barns and greenhouses."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from bushseg.simulation.materials import (
    BRICK,
    CONCRETE,
    METAL,
    PLASTER,
    STONE,
    TILES,
    WOOD,
    Material,
)
from bushseg.simulation.mesh import Mesh, Model, Surface, box, join, polyhedron, tubes
from bushseg.simulation.structures.facades import balconies, door, dormer, porch, windows

BuildingForm = Literal["gable", "flat", "block", "garage", "shed", "barn", "greenhouse"]
BUILDING_FORMS: tuple[BuildingForm, ...] = get_args(BuildingForm)

FOOTING = 1.5
"""How far buildings reach below their origin, metres, so that they stand on a slope."""

SIZES: dict[BuildingForm, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]] = {
    "gable": ((7, 13), (5.5, 9), (2.6, 5.6)),
    "flat": ((5, 14), (4, 10), (2.5, 6.5)),
    "block": ((10, 19), (8, 12), (5.4, 9.8)),
    "garage": ((5, 7), (2.8, 6), (2.2, 2.8)),
    "shed": ((2.2, 6), (1.8, 4), (1.8, 2.6)),
    "barn": ((10, 18), (7, 11), (3.5, 5.5)),
    "greenhouse": ((3, 10), (2.2, 4), (1.4, 1.9)),
}
"""Least and greatest length, width and height of the eaves, metres."""


@dataclass(frozen=True, slots=True)
class Building:
    """A building around its own origin, its length along x.

    Attributes:
        model: Its surfaces.
        length: Length along x, metres.
        width: Width along y, metres.
    """

    model: Model
    length: float
    width: float

    @property
    def radius(self) -> float:
        """Of the circle that holds it, metres."""
        return float(np.hypot(self.length, self.width)) / 2


def building(rng: np.random.Generator, form: BuildingForm, largest: float = 20.0) -> Building:
    """Draw a building.

    Args:
        rng: Source of randomness.
        form: Its kind.
        largest: It is no longer than this, metres.
    """
    length, width, eaves = (float(rng.uniform(*limits)) for limits in SIZES[form])
    length = min(length, largest)
    width = min(width, 0.85 * length)
    walls = (PLASTER, PLASTER, BRICK, WOOD)[rng.integers(4)]
    if form == "gable":
        model = _gable(rng, length, width, eaves, walls, lived_in=True)
    elif form == "barn":
        model = _gable(rng, length, width, eaves, WOOD, lived_in=False)
    elif form == "greenhouse":
        model = _greenhouse(length, width, eaves)
    elif form == "shed":
        model = _shed(length, width, eaves, rise=float(rng.uniform(0.2, 0.7)))
    else:
        model = _flat(rng, length, width, eaves, walls, windows_in=form != "garage")
    return Building(model, length, width)


def _gable(
    rng: np.random.Generator,
    length: float,
    width: float,
    eaves: float,
    material: Material,
    *,
    lived_in: bool,
) -> Model:
    """A house with a gable roof along x, windows and a door."""
    x, y, ridge = length / 2, width / 2, eaves + rng.uniform(0.3, 0.5) * width
    walls = polyhedron(
        [
            *[(sx * x, sy * y, z) for z in (-FOOTING, eaves) for sx in (-1, 1) for sy in (-1, 1)],
            (-x, 0, ridge),
            (x, 0, ridge),
        ],
        [(0, 1, 5, 8, 4), (2, 3, 7, 9, 6), (0, 2, 6, 4), (1, 3, 7, 5)],
    )
    model = [
        Surface(walls, material),
        Surface(join([_slab(x, y, eaves, ridge, side) for side in (-1, 1)]), TILES),
        *windows(rng, length, y, eaves),
        door(y, FOOTING),
    ]
    if lived_in:
        for side in (-1, 1):
            if ridge - eaves > 2.2 and rng.random() < 0.5:
                at = rng.uniform(-0.3, 0.3) * length
                model += dormer(at, y, eaves, ridge, side, material)
        if rng.random() < 0.4:
            model += porch(rng, y)
        if eaves > 4.9 and rng.random() < 0.3:
            model += balconies(rng, length, y, eaves)
        low, high = (0.2 * length, -0.3, eaves), (0.2 * length + 0.6, 0.3, ridge + 0.7)
        model.append(Surface(box(low, high), STONE))
    return model


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


def _flat(
    rng: np.random.Generator,
    length: float,
    width: float,
    eaves: float,
    material: Material,
    *,
    windows_in: bool,
) -> Model:
    """A block with a parapet and a unit on its roof, balconies where it is high; or a garage."""
    x, y = length / 2, width / 2
    rim = [
        box((-x, side * y - 0.12, eaves), (x, side * y + 0.12, eaves + 0.35)) for side in (-1, 1)
    ]
    body = Surface(join([box((-x, -y, -FOOTING), (x, y, eaves)), *rim]), material)
    if not windows_in:
        return [body, Surface(box((-0.42 * x, -y - 0.03, 0), (0.42 * x, -y, 2.0)), METAL)]
    unit = box((0.1 * x, -0.3 * y, eaves), (0.5 * x, 0.2 * y, eaves + 1.1))
    model = [body, Surface(unit, METAL), *windows(rng, length, y, eaves), door(y, FOOTING)]
    if eaves > 4.9 and rng.random() < 0.7:
        model += balconies(rng, length, y, eaves)
    return model


def _shed(length: float, width: float, eaves: float, rise: float) -> Model:
    """A hut of boards with a roof that slopes one way, `rise` metres."""
    x, y = length / 2, width / 2
    corners = [
        (sx * x, sy * y, z)
        for sx in (-1, 1)
        for sy, top in ((-1, eaves), (1, eaves + rise))
        for z in (-FOOTING, top)
    ]
    sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6)]
    low, high = eaves - 0.2 * rise / y, eaves + rise * (1 + 0.2 / width)
    roof = [
        (sx * (x + 0.2), sy * (y + 0.2), z + lift)
        for lift in (0.0, 0.06)
        for sx in (-1, 1)
        for sy, z in ((-1, low), (1, high))
    ]
    slab = polyhedron(roof, [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6)])
    return [Surface(polyhedron(corners, sides), WOOD), Surface(slab, METAL)]


def _greenhouse(length: float, width: float, eaves: float) -> Model:
    """Glass between thin bars under a gable: most rays pass or are mirrored away."""
    x, y, ridge = length / 2, width / 2, eaves + 0.35 * width
    hoops = []
    for at in np.linspace(-x, x, max(round(length / 0.8), 2) + 1):
        hoops.append([(at, -y, -0.2), (at, -y, eaves), (at, 0, ridge), (at, y, eaves)])
        hoops.append([(at, y, -0.2), (at, y, 0.4 * eaves), (at, y, 0.8 * eaves), (at, y, eaves)])
    paths = np.array(hoops, np.float64)
    bars = tubes(paths, np.full(paths.shape[:2], 0.025), sides=4)
    purlins = np.array(
        [[(-x, t, z), (x, t, z)] for t, z in ((-y, eaves), (y, eaves), (0, ridge), (-y, 0.4))]
    )
    rails = tubes(purlins, np.full((4, 2), 0.025), sides=4)
    base = box((-x, -y, -FOOTING), (x, y, 0.25))
    return [Surface(join([bars, rails]), METAL), Surface(base, CONCRETE)]
