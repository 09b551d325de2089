"""Sensors: where they stand and the rays they send, in the order they send them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.site import Site

BATCH_RAYS = 500_000
PULSE_RATE = 500_000.0
"""Rays a second, which gives the points their times."""

TRIPOD_HEIGHT = 1.7
TRIPOD_ELEVATIONS = (-60.0, 85.0)
SPINNING_HEIGHT = 1.2
SPINNING_ELEVATIONS = (-24.8, 15.0)
SPINNING_BEAMS = 64
SPINNING_COLUMNS = 2000


@dataclass(frozen=True, slots=True)
class Rays:
    """Some consecutive rays of one station.

    Attributes:
        origins: Where they start, metres, shape (M, 3), float64.
        directions: Unit vectors, shape (M, 3), float64.
        station: The station's number, from 1.
        first: The first ray's place among the station's rays.
    """

    origins: FloatArray
    directions: FloatArray
    station: int
    first: int


def tripod(site: Site, config: SimulateConfig) -> Iterator[Rays]:
    """A terrestrial scanner: columns of elevations, one azimuth after another."""
    step = config.angular_step
    low, high = TRIPOD_ELEVATIONS
    elevations = np.arange(low, high, step)
    azimuths = np.arange(0, 360 - step / 2, step)
    for number, foot in enumerate(site.stations, start=1):
        origin = foot + np.array([0, 0, TRIPOD_HEIGHT])
        yield from _turn(origin, azimuths, elevations, number)


def spinning(site: Site, _config: SimulateConfig) -> Iterator[Rays]:
    """One turn of a 64-beam LiDAR at the first station, fixed by its make."""
    low, high = SPINNING_ELEVATIONS
    elevations = np.linspace(low, high, SPINNING_BEAMS, dtype=np.float64)
    azimuths = np.linspace(0, 360, SPINNING_COLUMNS, endpoint=False, dtype=np.float64)
    yield from _turn(spinning_origin(site), azimuths, elevations, 1)


def spinning_origin(site: Site) -> FloatArray:
    """Where the spinning LiDAR stands, metres, shape (3,)."""
    origin: FloatArray = site.stations[0] + np.array([0, 0, SPINNING_HEIGHT])
    return origin


def airborne(site: Site, config: SimulateConfig) -> Iterator[Rays]:
    """Parallel flight lines along y; across each, a mirror sweeps from side to side."""
    ground = site.terrain.heights
    top = ground.max() + config.flight_height
    half_width = np.tan(np.radians(config.scan_angle)) * (top - ground.mean())
    across = np.arange(-half_width, half_width, config.pulse_spacing)
    down = np.full_like(across, ground.mean() - top)
    swing = np.stack([across, np.zeros_like(across), down], axis=1)
    swing /= np.linalg.norm(swing, axis=1, keepdims=True)
    lines = (np.arange(config.stations) + 0.5) / config.stations * config.size
    steps = np.arange(config.pulse_spacing / 2, config.size, config.pulse_spacing)
    per_batch = max(BATCH_RAYS // len(swing), 1)
    for number, x in enumerate(lines, start=1):
        for start in range(0, len(steps), per_batch):
            y = steps[start : start + per_batch].repeat(len(swing))
            origins = np.stack([np.full_like(y, x), y, np.full_like(y, top)], axis=1)
            directions = np.tile(swing, (len(y) // len(swing), 1))
            yield Rays(origins, directions, number, start * len(swing))


Sensor = Callable[[Site, SimulateConfig], Iterator[Rays]]

SENSORS: dict[str, Sensor] = {"tripod": tripod, "airborne": airborne, "spinning": spinning}


def _turn(
    origin: FloatArray,
    azimuths: FloatArray,
    elevations: FloatArray,
    station: int,
) -> Iterator[Rays]:
    """Rays from `origin` (3,): at each azimuth all elevations, degrees, in batches of columns."""
    per_batch = max(BATCH_RAYS // len(elevations), 1)
    up, out = np.sin(np.radians(elevations)), np.cos(np.radians(elevations))
    for start in range(0, len(azimuths), per_batch):
        angles = np.radians(azimuths[start : start + per_batch])[:, None]
        directions = np.stack(
            [
                np.cos(angles) * out,
                np.sin(angles) * out,
                np.broadcast_to(up, (len(angles), len(up))),
            ],
            axis=-1,
        ).reshape(-1, 3)
        origins = np.broadcast_to(origin, directions.shape)
        yield Rays(origins, directions, station, start * len(elevations))
