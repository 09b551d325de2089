"""Grass: lawn, meadow, tall grass and reed, in tufts of blades."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.materials import DRY_GRASS, GRASS
from bushseg.simulation.mesh import Mesh, Model, Surface
from bushseg.simulation.plants.config import GrassStand, PlantsConfig
from bushseg.simulation.plants.distributions import draw
from bushseg.simulation.plants.scatter import assigned, patches

TUFT = 0.05
"""Blades of a tuft stand within about this much of its middle, metres."""

BENT = 0.25
"""Blades above this height are drawn with a bend, metres."""


class Ground(Protocol):
    """What plants stand on; `Terrain` is one."""

    def height(self, xy: FloatArray) -> FloatArray:
        """Heights (N,) at places (N, 2), metres."""


def grow_grass(
    rng: np.random.Generator,
    config: PlantsConfig,
    terrain: Ground,
    xy: FloatArray,
    stand: GrassStand | None = None,
) -> Model:
    """Grow a tuft of grass at each place: class "low vegetation".

    Args:
        rng: Source of randomness.
        config: Heights, blades, and how common each stand is.
        terrain: The ground.
        xy: Where tufts stand, metres, shape (N, 2).
        stand: The kind of stand everywhere; None divides the area among all, in patches.

    Returns:
        Green and dry blades, as far as there are any.
    """
    if not len(xy):
        return []
    heights = _heights(rng, config, xy, stand)
    dry = patches(rng, xy, config.patch_size) + rng.standard_normal(len(xy))
    is_dry = dry > np.quantile(dry, 1 - config.dry_grass)
    tufts = np.column_stack([xy, terrain.height(xy), heights])
    return [
        Surface(_blades(rng, config, terrain, tufts[chosen]), material)
        for chosen, material in ((~is_dry, GRASS), (is_dry, DRY_GRASS))
        if chosen.any()
    ]


def _heights(
    rng: np.random.Generator, config: PlantsConfig, xy: FloatArray, stand: GrassStand | None
) -> FloatArray:
    """Heights of tufts (N,), metres: each patch of a stand has its own."""
    weights = config.grass_stands if stand is None else {stand: 1.0}
    spreads = {
        "lawn": config.lawn_height,
        "meadow": config.meadow_height,
        "tall": config.tall_grass_height,
    }
    kinds = assigned(rng, xy, list(weights.values()), config.patch_size)
    typical = np.array([draw(rng, spreads[name]) for name in weights])[kinds]
    lush = np.exp(0.22 * patches(rng, xy, config.patch_size / 2))
    heights: FloatArray = typical * lush * rng.uniform(0.7, 1.2, len(xy))
    return heights


def _blades(
    rng: np.random.Generator, config: PlantsConfig, terrain: Ground, tufts: FloatArray
) -> Mesh:
    """Blades of tufts at x, y, z and of a height, shape (N, 4): one triangle, two where tall."""
    number = config.grass_blades * len(tufts)
    each = tufts.repeat(config.grass_blades, axis=0)
    width = draw(rng, config.grass_blade_width)
    height = each[:, 3] * rng.uniform(0.45, 1.1, number)
    spread = np.minimum(TUFT, 0.03 + 0.1 * height)[:, None]
    xy = each[:, :2] + spread * rng.standard_normal((number, 2))
    root = np.column_stack([xy, terrain.height(xy) - 0.01])
    yaw = rng.uniform(0, 2 * np.pi, number)
    flat = np.zeros(number)
    across = 0.5 * width * np.stack([np.cos(yaw), np.sin(yaw), flat], axis=1)
    across *= rng.uniform(0.6, 1.4, (number, 1))
    # Blades lean with the wind and away from the tuft's middle.
    wind = rng.normal(0, 0.12, 2)
    lean = (wind + rng.normal(0, 0.3, (number, 2))) * height[:, None]
    tip = root + np.column_stack([lean, height])
    bend = root + np.column_stack([0.25 * lean, 0.62 * height])
    tall = height > BENT
    short = np.stack([root - across, root + across, tip], axis=1)[~tall]
    lower = np.stack([root - across, root + across, bend + 0.7 * across], axis=1)[tall]
    upper = np.stack([bend + 0.7 * across, bend - 0.5 * across, tip], axis=1)[tall]
    vertices = np.concatenate([short, lower, upper]).reshape(-1, 3)
    triangles: NDArray[np.intp] = np.arange(len(vertices)).reshape(-1, 3)
    return Mesh.of(vertices, triangles)
