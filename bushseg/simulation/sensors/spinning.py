"""LiDARs that turn on a vehicle, a robot or a back: single frames, and turns put together."""

from collections.abc import Iterator

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.sensors.figures import BEAMS
from bushseg.simulation.sensors.rays import BATCH_RAYS, Pose, Rays, cast_from, spherical
from bushseg.simulation.sensors.route import Route
from bushseg.simulation.site import Site


def frame_rays(rng: np.random.Generator, site: Site, config: SensorConfig) -> Iterator[Rays]:
    """Single turns spread along the path, each a station of its own and in its own coordinates.

    A turn is as if the vehicle stood still: what drivers call deskewed.
    """
    route = Route.of(rng, site, config.figures, rides=True)
    own = Pose(np.zeros(3), np.eye(3))
    for number in range(config.frames):
        arc = (number + 0.5) / config.frames * route.length
        yield from _turn(rng, route.pose(arc), own, config, number + 1, 0)


def map_rays(rng: np.random.Generator, site: Site, config: SensorConfig) -> Iterator[Rays]:
    """Turns along the whole path, put together by where the sensor is thought to have been."""
    figures = config.figures
    route = Route.of(rng, site, figures, rides=config.kind == "vehicle")
    first = 0
    for turn, arc in enumerate(np.arange(0, route.length + 1e-9, figures.turn_spacing)):
        pose = route.pose(float(arc), turn)
        for rays in _turn(rng, pose, route.believed(pose, float(arc)), config, 1, first):
            first += len(rays)
            yield rays


def turn_of(rng: np.random.Generator, config: SensorConfig) -> FloatArray:
    """One turn's directions in the sensor's own coordinates, column by column, (M, 3)."""
    if config.beams is None:
        raise ValueError(f"a {config.kind} sensor has no beams that turn")
    step = config.figures.angular_step
    columns = round(360 / step)
    start = rng.uniform(0, 1) + config.figures.line_jitter * rng.uniform(-0.5, 0.5, columns)
    azimuths = (np.arange(columns) + start) * (360 / columns)
    return spherical(azimuths[:, None], BEAMS[config.beams]).reshape(-1, 3)


def _turn(
    rng: np.random.Generator,
    true: Pose,
    reported: Pose,
    config: SensorConfig,
    station: int,
    first: int,
) -> Iterator[Rays]:
    """One turn's rays, in batches."""
    local = turn_of(rng, config)
    for start in range(0, len(local), BATCH_RAYS):
        some = local[start : start + BATCH_RAYS]
        yield cast_from(true, reported, some, station, first + start)
