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
from bushseg.simulation.sensors.rays import Rays
from bushseg.simulation.sensors.scanner import scan
from bushseg.simulation.sensors.spinning import frame_rays, map_rays
from bushseg.simulation.sensors.tripod import tripod_rays
from bushseg.simulation.sensors.variety import varied
from bushseg.simulation.site import Site

RaysOf = Callable[[np.random.Generator, Site, SensorConfig], Iterator[Rays]]

SENSORS: dict[Kind, RaysOf] = {
    "tripod": tripod_rays,
    "phase": tripod_rays,
    "mobile": map_rays,
    "spinning": frame_rays,
    "vehicle": map_rays,
    "uav": strip_rays,
    "airborne": strip_rays,
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
    rays = SENSORS[config.kind](of_rays, site, config)
    returns = scan(of_noise, site.scene, rays, config)
    if config.kind != "spinning":
        path = stem.with_name(f"{stem.name}.laz")
        return {path: write_laz(path, returns, origin, color=config.color)}
    written = {}
    for number, frame in groupby(returns, key=lambda batch: batch.station):
        name = stem.name if config.frames == 1 else f"{stem.name}_{number - 1:03d}"
        path = stem.with_name(f"{name}.bin")
        written[path] = write_kitti(path, frame)
    return written
