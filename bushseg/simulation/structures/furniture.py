"""Furniture of gardens, parks, farms and yards."""

from collections.abc import Callable

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.materials import CONCRETE, METAL, PAINT, STRAW, WOOD
from bushseg.simulation.mesh import Mesh, Model, Surface, box, instances, join, tube, tubes


def bench(rng: np.random.Generator) -> Model:
    """A bench along x, with or without a back."""
    x = rng.uniform(0.7, 1.0)
    parts = [box((-x, -0.22, 0.42), (x, 0.22, 0.47))]
    parts += [
        box((s * 0.8 * x - 0.04, -0.2, -0.1), (s * 0.8 * x + 0.04, 0.2, 0.42)) for s in (-1, 1)
    ]
    if rng.random() < 0.7:
        parts += [box((-x, 0.2, z), (x, 0.24, z + 0.12)) for z in (0.55, 0.75)]
    return [Surface(join(parts), WOOD)]


def table(rng: np.random.Generator) -> Model:
    """A picnic table along x, its benches fixed to it."""
    x = rng.uniform(0.8, 1.1)
    parts = [box((-x, -0.38, 0.72), (x, 0.38, 0.76))]
    parts += [box((-x, s * 0.7 - 0.14, 0.43), (x, s * 0.7 + 0.14, 0.47)) for s in (-1, 1)]
    legs = [
        tube([(sx * 0.7 * x, s * 0.75, -0.05), (sx * 0.7 * x, s * 0.2, 0.74)], [0.04, 0.04], 4)
        for sx in (-1, 1)
        for s in (-1, 1)
    ]
    return [Surface(join([*parts, *legs]), WOOD)]


def bin_(rng: np.random.Generator) -> Model:
    """A wheeled bin or a round litter bin of about 1 m."""
    if rng.random() < 0.5:
        return [Surface(box((-0.3, -0.35, 0), (0.3, 0.35, 1.05)), PAINT[2])]
    return [Surface(tube([(0, 0, 0), (0, 0, 0.85)], [0.22, 0.25], 12), METAL)]


def swing(rng: np.random.Generator) -> Model:
    """A frame of swings along x, 2 to 2.6 m high."""
    x, z = rng.uniform(1.2, 2.0), rng.uniform(2.0, 2.6)
    rods = [[(sx * x, sy * 0.9, -0.1), (sx * x, 0, z)] for sx in (-1, 1) for sy in (-1, 1)]
    rods.append([(-x, 0, z), (x, 0, z)])
    ropes = [[(at, 0, z), (at, 0, 0.5)] for at in (-0.55, -0.15, 0.15, 0.55)]
    seats = [box((at - 0.22, -0.1, 0.46), (at + 0.22, 0.1, 0.5)) for at in (-0.35, 0.35)]
    frame = np.array(rods, np.float64)
    hung = np.array(ropes, np.float64)
    poles = tubes(frame, np.full((len(frame), 2), 0.05))
    chains = tubes(hung, np.full((len(hung), 2), 0.01), sides=3)
    return [Surface(join([poles, *seats]), WOOD), Surface(chains, METAL)]


def climbing_frame(rng: np.random.Generator) -> Model:
    """A lattice of bars, 1.5 to 2.5 m high."""
    steps, z = int(rng.integers(2, 4)), rng.uniform(1.5, 2.5)
    at = np.linspace(-0.6, 0.6, steps) * steps / 2
    grid: list[list[tuple[float, float, float]]] = [
        [(x, y, -0.1), (x, y, z)] for x in at for y in at
    ]
    for level in np.linspace(0.5, z, 4):
        grid += [[(x, at[0], level), (x, at[-1], level)] for x in at]
        grid += [[(at[0], y, level), (at[-1], y, level)] for y in at]
    paths = np.array(grid, np.float64)
    return [Surface(tubes(paths, np.full((len(paths), 2), 0.022), sides=5), PAINT[0])]


def hay_bale(rng: np.random.Generator) -> Model:
    """A round bale lying on its side, or a stack of square ones."""
    if rng.random() < 0.6:
        r = rng.uniform(0.6, 0.85)
        return [Surface(tube([(0, -0.6, r - 0.03), (0, 0.6, r - 0.03)], [r, r], 18), STRAW)]
    bale = box((-0.5, -0.25, 0), (0.5, 0.25, 0.4))
    rows, levels = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    places = [(0.0, 0.52 * row, 0.4 * level) for level in range(levels) for row in range(rows)]
    return [Surface(instances(bale, np.array(places)), STRAW)]


def wood_stack(rng: np.random.Generator) -> Model:
    """Logs stacked along y: their ends show along x."""
    length, height = rng.uniform(1.0, 4.0), rng.uniform(0.6, 1.6)
    radius = rng.uniform(0.05, 0.16)
    return [Surface(_stack(rng, length, height, radius, rng.uniform(0.4, 1.2)), WOOD)]


def pipes(rng: np.random.Generator) -> Model:
    """Concrete or plastic pipes in a heap, 2 to 5 m long, along y."""
    radius = rng.uniform(0.08, 0.3)
    material = (CONCRETE, PAINT[2])[rng.integers(2)]
    stack = _stack(rng, 8 * radius, 4 * radius, radius, rng.uniform(1, 2.5))
    return [Surface(stack, material)]


def _stack(
    rng: np.random.Generator, length: float, height: float, radius: float, half: float
) -> Mesh:
    """Rods of `radius` along y, `half` their length, filling `length` by `height`, metres."""
    columns = max(int(length / (2 * radius)), 1)
    rows = max(int(height / (1.75 * radius)), 1)
    where: list[tuple[float, float]] = [
        ((column - columns / 2 + 0.5 * (row % 2)) * 2 * radius, radius + 1.75 * radius * row)
        for row in range(rows)
        for column in range(columns - row % 2)
    ]
    at: FloatArray = np.array(where, np.float64).reshape(-1, 2)
    ends = rng.normal((-half, half), 0.05, (len(at), 2))
    paths = np.stack(
        [np.stack([at[:, 0], ends[:, side], at[:, 1]], axis=1) for side in (0, 1)], axis=1
    )
    radii = radius * rng.uniform(0.8, 1.02, (len(at), 1)) * np.ones(2)
    return tubes(paths, radii, sides=8)


def pallets(rng: np.random.Generator) -> Model:
    """A pile of pallets, or one loaded with blocks."""
    levels = int(rng.integers(1, 9))
    deck = join(
        [box((-0.6, y - 0.06, 0.1), (0.6, y + 0.06, 0.14)) for y in np.linspace(-0.34, 0.34, 5)]
        + [box((x - 0.05, -0.4, 0), (x + 0.05, 0.4, 0.1)) for x in (-0.5, 0, 0.5)]
    )
    if rng.random() < 0.5:
        return [
            Surface(instances(deck, np.array([(0, 0, 0.145 * n) for n in range(levels)])), WOOD)
        ]
    load = box((-0.55, -0.38, 0.14), (0.55, 0.38, rng.uniform(0.5, 1.4)))
    return [Surface(deck, WOOD), Surface(load, CONCRETE)]


def trough(rng: np.random.Generator) -> Model:
    """A trough, planter or tank of 1 to 2.5 m."""
    x, y, z = rng.uniform(0.5, 1.25), rng.uniform(0.3, 0.6), rng.uniform(0.4, 0.9)
    return [Surface(box((-x, -y, -0.1), (x, y, z)), (CONCRETE, METAL, WOOD)[rng.integers(3)])]


FURNITURE: dict[str, Callable[[np.random.Generator], Model]] = {
    "bench": bench,
    "table": table,
    "bin": bin_,
    "swing": swing,
    "climbing frame": climbing_frame,
    "hay bale": hay_bale,
    "wood stack": wood_stack,
    "pipes": pipes,
    "pallets": pallets,
    "trough": trough,
}
