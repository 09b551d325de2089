"""Simulating sites, one file each."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bushseg.points import FloatArray
from bushseg.progress import SILENT, Progress
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.output import write_kitti, write_laz
from bushseg.simulation.scanner import Returns, scan
from bushseg.simulation.sensors import SENSORS, spinning_origin
from bushseg.simulation.site import make_site

FIRST_ORIGIN = np.array([500_000.0, 5_400_000.0, 250.0])


def simulate(output: Path, config: SimulateConfig, *, progress: Progress = SILENT) -> list[Path]:
    """Make up sites, scan them and write the scans, with exact labels.

    Sites are called `site_000`, `site_001` and so on and lie side by side; an existing file of
    that name is replaced. A site depends on the seed and its number alone, so that asking for more
    sites leaves the first ones as they were.

    Args:
        output: The folder to write to; created if need be.
        config: What the sites hold and how they are scanned.
        progress: Told of each site, and of the points it gave.

    Returns:
        The scans in order: LAZ files, or for the spinning sensor .bin files, each of which has a
        .label beside it.

    Raises:
        DataError: A site gave no return at all.
        WriteError: The folder can't be created or written to.
    """
    progress.start("simulating sites", config.num_sites, "sites")
    suffix = ".bin" if config.sensor == "spinning" else ".laz"
    paths = []
    for number in range(config.num_sites):
        path = Path(output) / f"site_{number:03d}{suffix}"
        num_points = _simulate_site(path, config, number)
        progress.note(f"{path}: {num_points:,} points")
        progress.advance(1)
        paths.append(path)
    return paths


def _simulate_site(path: Path, config: SimulateConfig, number: int) -> int:
    """Make, scan and write one site; return its number of points (or of rays, for a frame)."""
    # Two streams: a sensor's setting doesn't change what stands on the site.
    site_seed, scan_seed = np.random.SeedSequence([config.seed, number]).spawn(2)
    site = make_site(np.random.default_rng(site_seed), config)
    rays = SENSORS[config.sensor](site, config)
    returns: Iterator[Returns] = scan(np.random.default_rng(scan_seed), site.scene, rays, config)
    if config.sensor == "spinning":
        return write_kitti(path, returns, spinning_origin(site))
    return write_laz(path, returns, _origin(config, number), color=config.color)


def _origin(config: SimulateConfig, number: int) -> FloatArray:
    """Projected coordinates (3,) of a site's corner, metres: sites stand in a row, eastwards."""
    east = number * np.ceil(config.size / 100) * 100
    return FIRST_ORIGIN + np.array([east, 0, 0])
