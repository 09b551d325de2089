"""Simulating sites, one scan or a few frames each."""

from pathlib import Path

import numpy as np

from bushseg.points import FloatArray
from bushseg.progress import SILENT, Progress
from bushseg.simulation.config import SimulateConfig
from bushseg.simulation.sensors.recording import record
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
        The scans in order: LAZ files, or for the spinning sensor .bin files (several frames of a
        site: `site_000_000.bin`, `site_000_001.bin`), each of which has a .label beside it.

    Raises:
        DataError: A site gave no return at all.
        WriteError: The folder can't be created or written to.
    """
    progress.start("simulating sites", config.num_sites, "sites")
    paths: list[Path] = []
    for number in range(config.num_sites):
        written = _simulate_site(Path(output) / f"site_{number:03d}", config, number)
        for path, num_points in written.items():
            progress.note(f"{path}: {num_points:,} points")
        progress.advance(1)
        paths.extend(written)
    return paths


def _simulate_site(stem: Path, config: SimulateConfig, number: int) -> dict[Path, int]:
    """Make, scan and write one site; return its files' numbers of points (of rays, for frames)."""
    # Two streams: a sensor's setting doesn't change what stands on the site.
    site_seed, scan_seed = np.random.SeedSequence([config.seed, number]).spawn(2)
    site = make_site(np.random.default_rng(site_seed), config)
    scan_rng = np.random.default_rng(scan_seed)
    return record(scan_rng, site, config.sensor, stem, _origin(config, number))


def _origin(config: SimulateConfig, number: int) -> FloatArray:
    """Projected coordinates (3,) of a site's corner, metres: sites stand in a row, eastwards."""
    east = number * np.ceil(config.size / 100) * 100
    return FIRST_ORIGIN + np.array([east, 0, 0])
