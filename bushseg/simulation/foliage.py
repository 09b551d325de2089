"""Leaves: a handful of sprigs, repeated by the thousand, and blades of grass."""

import numpy as np
from scipy.spatial.transform import Rotation

from bushseg.points import FloatArray
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.materials import GRASS
from bushseg.simulation.mesh import Mesh, Model, Surface, instances
from bushseg.simulation.terrain import Terrain, on_drive, waves

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def _sprig(num_leaves: int, twig: float, length: float, width: float, tilt: float) -> Mesh:
    """A twig's leaves, spiralling up z; each leaf is two triangles folded along its midrib.

    Args:
        num_leaves: Leaves on the twig.
        twig: The twig's length, metres; the twig itself is too thin to be drawn.
        length: A leaf's length, metres.
        width: A leaf's width, metres.
        tilt: Angle of the leaves above the horizontal, degrees.
    """
    fold = 0.15 * width
    leaf = Mesh.of(
        [(0, 0, 0), (length / 2, -width / 2, fold), (length, 0, 0), (length / 2, width / 2, fold)],
        [(0, 1, 2), (0, 2, 3)],
    )
    turns = np.arange(num_leaves)
    angles = np.stack([turns * GOLDEN_ANGLE, np.full(num_leaves, -np.radians(tilt))], axis=1)
    positions = np.zeros((num_leaves, 3))
    positions[:, 2] = turns * (twig / num_leaves)
    return instances(leaf, positions, Rotation.from_euler("ZY", angles).as_matrix())


SPRIGS = {
    "broad": _sprig(8, twig=0.12, length=0.075, width=0.045, tilt=25),
    "small": _sprig(12, twig=0.10, length=0.035, width=0.022, tilt=35),
    "narrow": _sprig(9, twig=0.14, length=0.10, width=0.022, tilt=45),
    "needle": _sprig(14, twig=0.15, length=0.11, width=0.018, tilt=30),
}
"""Prototypes by name, life-size; a tree of thousands of leaves takes them larger."""


def leaf_area(sprig: str) -> float:
    """One-sided area of a sprig's leaves, square metres."""
    mesh = SPRIGS[sprig]
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def foliage(
    rng: np.random.Generator, sprig: str, positions: FloatArray, scale: float = 1.0
) -> Mesh:
    """Put a sprig, anyhow turned and about `scale` times life-size, at `positions` (N, 3)."""
    turns = rng.standard_normal((len(positions), 4))
    turns[:, 3] += 1.0  # rather upright than not
    scales = scale * rng.uniform(0.7, 1.3, len(positions))
    return instances(SPRIGS[sprig], positions, Rotation.from_quat(turns).as_matrix(), scales)


def meadow(
    rng: np.random.Generator, terrain: Terrain, config: SimulateConfig, drive: FloatArray | None
) -> Model:
    """Grow grass in patches, blade by blade.

    Args:
        rng: Source of randomness.
        terrain: The ground it grows on.
        config: The site's size and how many blades grow.
        drive: The ends of a drive on which none grow, metres, shape (2, 2), or None.

    Returns:
        One surface of one triangle a blade; none where no blade grows.
    """
    num_blades = round(config.grass_density * config.size**2)
    xy = rng.uniform(0, config.size, (3 * num_blades, 2))
    lush = waves(rng, xy, shortest=2, longest=12)
    chosen = np.argsort(-(lush + 0.8 * rng.standard_normal(len(xy))), kind="stable")[:num_blades]
    chosen = chosen[~on_drive(xy[chosen], drive)]
    xy, lush = xy[chosen], lush[chosen]
    if not len(xy):
        return []
    heights = np.clip(0.12 + 0.08 * lush, 0.05, None) * rng.uniform(0.6, 1.6, len(xy))
    yaw = rng.uniform(0, 2 * np.pi, len(xy))
    across = 0.008 * np.stack([np.cos(yaw), np.sin(yaw), np.zeros(len(xy))], axis=1)
    root = np.column_stack([xy, terrain.height(xy)])
    lean = rng.normal(0, 0.3, (len(xy), 2)) * heights[:, None]
    tip = root + np.column_stack([lean, heights])
    vertices = np.stack([root - across, root + across, tip], axis=1).reshape(-1, 3)
    return [Surface(Mesh.of(vertices, np.arange(len(vertices)).reshape(-1, 3)), GRASS)]
