"""One scan's tiles as a job of another process: from a file to a folder of tiles."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from bushseg.cache import fingerprint, output_identity
from bushseg.config import PrepareConfig, Section
from bushseg.errors import ReadError
from bushseg.io import label_sidecar
from bushseg.memory import be_lean, give_back
from bushseg.prepared import SCANS
from bushseg.scan_tiles import write_tiles
from bushseg.scheme import ClassScheme


class TilesJob(Section):
    """What a job is told, as JSON: checked where it is given out, and where it arrives."""

    folder: str = Field(description="For the job's marks, two levels below the data set's folder")
    place: str = Field(
        pattern=r"^[^/\\\x00]*-[0-9a-f]{16}$", description="The tiles' folder among the scans'"
    )
    scan: str = Field(description="The scan, absolute")
    name: str = Field(description="What the user calls it")
    content: str = Field(description="What the scan holds, by `content_of`")
    config: PrepareConfig = Field(description="Settings")
    classes: ClassScheme = Field(description="The scheme that the settings name")
    max_voxels: Annotated[int, Field(gt=0)] = Field(description="Voxels to hold in memory")
    lean: bool = Field(description="Whether freed memory goes back to the system at once")


def prepare_scan_job(**arguments: Any) -> None:
    """Write one scan's tiles as :func:`bushseg.prepare` does, in one process.

    Args:
        **arguments: Those of :class:`TilesJob`.

    Raises:
        ConfigError: An argument isn't as it should be.
        BushsegError: The scan can't be read, isn't the one that is meant, or the disk refuses.
    """
    job = TilesJob.from_dict(arguments, "job")
    place = Path(job.folder).parents[1] / SCANS / job.place
    scan = Path(job.scan)
    if not scan.exists():
        raise ReadError(scan, "isn't there for the worker", "a folder that all workers share")
    if content_of(scan) != job.content:
        raise ReadError(
            scan, "was changed meanwhile, or is another file for the worker", "one that stays"
        )
    if job.lean:
        be_lean()
    write_tiles(scan, place, job.config, job.classes, job.max_voxels, name=job.name)
    give_back()


def content_of(scan: Path) -> str:
    """What tells a scan and its labels from others, on any machine that sees them.

    Times and paths don't: file systems round the ones, and machines name the others as they like.
    """
    files = [output_identity(file) for file in (scan, label_sidecar(scan)) if file is not None]
    return fingerprint({"files": [(file["size"], file["edges"]) for file in files]})
