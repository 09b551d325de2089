"""The scans of a data set become tiles: one after the other, or at once in other processes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bushseg.config import PrepareConfig
from bushseg.errors import WorkerError
from bushseg.jobs import PREPARE_SCAN, Scheduler
from bushseg.prepare_jobs import TilesJob, content_of
from bushseg.prepared import MANIFEST, SCANS
from bushseg.progress import Progress
from bushseg.scan_tiles import finished_tiles, write_tiles
from bushseg.schedulers import jobs_folder, opened, run_twice, wait_until_seen
from bushseg.scheme import ClassScheme
from bushseg.stages import Stages


@dataclass(frozen=True, slots=True)
class Makers:
    """Who makes tiles.

    Attributes:
        max_voxels: Voxels that each process holds in memory.
        lean: Whether freed memory goes back to the system at once.
        workers: Processes beside this one; 1 for none.
        scheduler: A Dask scheduler's address; None for none.
        insecure: Whether another machine's may be called without TLS.
    """

    max_voxels: int
    lean: bool = False
    workers: int = 1
    scheduler: str | None = None
    insecure: bool = False


def make_tiles(
    due: Mapping[Path, Path],
    folder: Path,
    config: PrepareConfig,
    scheme: ClassScheme,
    makers: Makers,
    progress: Progress,
    stages: Stages,
) -> dict[Path, dict[str, Any]]:
    """Write the tiles of some scans.

    Args:
        due: The scans, and their folders in the data set.
        folder: The data set's, in which nobody else works.
        config: Settings.
        scheme: The classes.
        makers: Who does it. A single scan is done here, unless there is a scheduler.
        progress: Told of points read and tiles made, or of scans where other processes work.
        stages: Told of the time that each step takes here.

    Returns:
        The manifests by scan.

    Raises:
        BushsegError: A scan can't be read, or the disk refuses; other processes end what they are
            at. Or a scan's process was lost twice: all others are finished.
    """
    workers = min(makers.workers, len(due))
    with opened(workers, makers.scheduler if due else None, insecure=makers.insecure) as scheduler:
        if scheduler is not None:
            return _elsewhere(due, folder, config, scheme, makers, scheduler, progress)
        return {
            scan: write_tiles(scan, place, config, scheme, makers.max_voxels, progress, stages)
            for scan, place in due.items()
        }


def _elsewhere(
    due: Mapping[Path, Path],
    folder: Path,
    config: PrepareConfig,
    scheme: ClassScheme,
    makers: Makers,
    scheduler: Scheduler,
    progress: Progress,
) -> dict[Path, dict[str, Any]]:
    """Have other processes write tiles; the largest scans come first, lest one keep all waiting."""
    scans = sorted(due, key=lambda scan: -scan.stat().st_size)
    refused: dict[Path, str] = {}
    lost: dict[Path, str] = {}
    (folder / SCANS).mkdir(exist_ok=True)  # no job makes it, nor removes it again if it is empty
    with jobs_folder(folder) as place:
        scheduler.check(place)
        jobs = {
            number: TilesJob(
                folder=str(place.absolute()),
                place=due[scan].name,
                scan=str(scan.absolute()),
                name=str(scan),
                content=content_of(scan),
                config=config,
                classes=scheme,
                max_voxels=makers.max_voxels,
                lean=makers.lean,
            ).model_dump(mode="json")
            for number, scan in enumerate(scans)
        }
        progress.start("preparing", len(jobs), "scans")
        for number, outcome in run_twice(scheduler, PREPARE_SCAN, jobs):
            if outcome.error is not None:
                refused[scans[number]] = outcome.error
                scheduler.stop()
            elif outcome.death is not None:
                lost[scans[number]] = outcome.death
            else:
                progress.advance(1)
    for scan in due:  # in the user's order
        if scan in refused:
            # As the user knows them.
            message = refused[scan].replace(str(scan.absolute()), str(scan))
            raise WorkerError(message.replace(str(folder.absolute()), str(folder)))
    if lost:
        told = "; ".join(
            f"{scan}: its worker was lost twice ({lost[scan]})" for scan in due if scan in lost
        )
        raise WorkerError(
            f"{told}; {len(due) - len(lost)} of {len(due)} scans are done and kept: make memory "
            "free, then start the same command again"
        )
    return {scan: _taken_up(place) for scan, place in due.items()}


def _taken_up(place: Path) -> dict[str, Any]:
    """The manifest that a job has left."""
    wait_until_seen(place / MANIFEST)
    manifest = finished_tiles(place)
    if manifest is None:
        raise WorkerError(
            f"{place}: its worker says that all tiles stand, but some aren't to be seen here; "
            "start the same command again"
        )
    return manifest
