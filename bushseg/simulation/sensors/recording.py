"""A site, scanned and written."""

from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.sensors.aerial import strip_rays
from bushseg.simulation.sensors.config import SensorConfig
from bushseg.simulation.sensors.figures import Kind
from bushseg.simulation.sensors.output import write_kitti, write_laz
from bushseg.simulation.sensors.photogrammetry import reconstruct
from bushseg.simulation.sensors.rays import Rays
from bushseg.simulation.sensors.scanner import Returns, scan
from bushseg.simulation.sensors.spinning import frame_rays, map_rays
from bushseg.simulation.sensors.tripod import tripod_rays
from bushseg.simulation.sensors.variety import varied
from bushseg.simulation.site import Site

Scan = Callable[[np.random.Generator, np.random.Generator, Site, SensorConfig], Iterator[Returns]]
RaysOf = Callable[[np.random.Generator, Site, SensorConfig], Iterator[Rays]]


def _by_rays(rays_of: RaysOf) -> Scan:
    """A sensor that sends rays, each of which is on its own."""

    def scanned(
        of_rays: np.random.Generator,
        of_noise: np.random.Generator,
        site: Site,
        config: SensorConfig,
    ) -> Iterator[Returns]:
        return scan(of_noise, site.scene, rays_of(of_rays, site, config), config)

    return scanned


def _by_pictures(
    of_rays: np.random.Generator, of_noise: np.random.Generator, site: Site, config: SensorConfig
) -> Iterator[Returns]:
    """A camera, whose pictures are matched."""
    return reconstruct(of_rays, of_noise, site, config)


SENSORS: dict[Kind, Scan] = {
    "tripod": _by_rays(tripod_rays),
    "phase": _by_rays(tripod_rays),
    "mobile": _by_rays(map_rays),
    "spinning": _by_rays(frame_rays),
    "vehicle": _by_rays(map_rays),
    "uav": _by_rays(strip_rays),
    "airborne": _by_rays(strip_rays),
    "photogrammetry": _by_pictures,
}


def record(
    rng: np.random.Generator, site: Site, config: SensorConfig, stem: Path, origin: FloatArray
) -> dict[Path, int]:
    """Scan a site and write what was seen.

    Args:
        rng: Source of all noise.
        site: What is scanned, and from where.
        config: The sensor.
        stem: The file's path without its suffix.
        origin: Projected coordinates of the site's origin, metres, shape (3,); frames have none.

    Returns:
        The files with their numbers of points: one `.laz`; of a spinning sensor one `.bin` a frame
        (with a `.label` beside it), its number after the stem where there are several.

    Raises:
        DataError: No ray came back.
        WriteError: The folder can't be written to.
    """
    of_rays, of_noise, of_figures = rng.spawn(3)
    if config.vary:
        config = varied(of_figures, config)
    returns = SENSORS[config.kind](of_rays, of_noise, site, config)
    if config.kind != "spinning":
        path = stem.with_name(f"{stem.name}.laz")
        return {path: write_laz(path, returns, origin, color=config.color)}
    written = {}
    for number, frame in groupby(returns, key=lambda batch: batch.station):
        name = stem.name if config.frames == 1 else f"{stem.name}_{number - 1:03d}"
        path = stem.with_name(f"{name}.bin")
        written[path] = write_kitti(path, frame)
    return written
