"""Scanners in the air: parallel flight strips, scan lines across each."""

from collections.abc import Iterator

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.sensors.figures import Figures
from bushseg.simulation.sensors.rays import BATCH_RAYS, Pose, Rays, about_z
from bushseg.simulation.site import Site


def strip_rays(rng: np.random.Generator, site: Site, config: SensorConfig) -> Iterator[Rays]:
    """Strips in a direction drawn at random, as many as see the site; only rays that aim at it."""
    figures = config.figures
    ground = site.terrain.heights
    size = (len(ground) - 1) * site.terrain.cell
    level, top = float(ground.mean()), float(ground.max()) + figures.flight_height
    half_width = float(np.tan(np.radians(figures.scan_angle))) * (top - level)
    turn = about_z(rng.uniform(0, 2 * np.pi))
    center = np.array([size / 2, size / 2, level])
    for number, offset in enumerate(strip_offsets(rng, figures, half_width, size), start=1):
        shift = Pose(np.zeros(3), np.eye(3)).mistaken(rng, figures.registration_noise)
        first = 0
        for plane, aims in _scan_lines(rng, figures, offset, half_width, size):
            # Rows of (along, across, up) from the site's center, turned into its coordinates.
            origins = np.column_stack([plane, np.full(len(plane), top - level)]) @ turn.T + center
            targets = np.column_stack([aims, np.zeros(len(aims))]) @ turn.T + center
            kept = ((targets[:, :2] >= 0) & (targets[:, :2] <= size)).all(axis=1)
            origins, targets = origins[kept], targets[kept]
            directions = targets - origins
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            yield Rays(origins, directions, origins + shift.position, directions, number, first)
            first += len(directions)


def strip_offsets(
    rng: np.random.Generator, figures: Figures, half_width: float, size: float
) -> FloatArray:
    """How far to the side of the site's center each strip runs that sees the site, metres, (S,).

    Neighbors are so far apart that each covers `overlap` of the next; where they lie is drawn.
    """
    spacing = 2 * half_width * (1 - figures.overlap)
    reach = half_width + size / 2  # farther out, a corner at most is seen
    first = rng.uniform(0, spacing)
    number = np.arange(np.ceil((-reach - first) / spacing), np.floor((reach - first) / spacing) + 1)
    return first + number * spacing


def _scan_lines(
    rng: np.random.Generator, figures: Figures, offset: float, half_width: float, size: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Where the plane is and where it aims at, metres along and across from the center, (M, 2).

    Scan lines begin anywhere, and lie as unevenly as `line_jitter` has it.
    """
    step, corner = figures.pulse_spacing, size / np.sqrt(2)
    low, high = max(offset - half_width, -corner), min(offset + half_width, corner)
    across = np.arange(low, high, step)
    along = np.arange(-corner, corner, step)
    along += figures.line_jitter * step * rng.uniform(-0.5, 0.5, len(along))
    starts = step * rng.uniform(-0.5, 0.5, len(along))
    per_batch = max(BATCH_RAYS // max(len(across), 1), 1)
    for first in range(0, len(along), per_batch):
        some = slice(first, first + per_batch)
        x = along[some].repeat(len(across))
        y = np.clip((starts[some, None] + across).ravel(), low, high)
        yield np.stack([x, np.full_like(x, offset)], axis=1), np.stack([x, y], axis=1)
