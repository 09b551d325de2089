"""Terrestrial scanners: a fast mirror, a slow head."""

from collections.abc import Iterator

import numpy as np

from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.sensors.rays import BATCH_RAYS, Pose, Rays, about_z, cast_from, spherical
from bushseg.simulation.site import Site


def tripod_rays(rng: np.random.Generator, site: Site, config: SensorConfig) -> Iterator[Rays]:
    """Columns of elevations, one azimuth after another, from each station."""
    figures = config.figures
    step = figures.angular_step
    elevations = np.arange(figures.lowest_angle, figures.highest_angle, step)
    azimuths = np.arange(0, 360 - step / 2, step)
    per_batch = max(BATCH_RAYS // len(elevations), 1)
    for number, foot in enumerate(site.stations, start=1):
        true = Pose(
            foot + np.array([0, 0, figures.sensor_height]), about_z(rng.uniform(0, 2 * np.pi))
        )
        reported = true.mistaken(rng, figures.registration_noise)
        shifts = figures.line_jitter * step * rng.uniform(-0.5, 0.5, (len(azimuths), 2))
        for start in range(0, len(azimuths), per_batch):
            some = slice(start, start + per_batch)
            local = spherical(
                (azimuths[some] + shifts[some, 0])[:, None], elevations + shifts[some, 1:]
            ).reshape(-1, 3)
            yield cast_from(true, reported, local, number, start * len(elevations))
