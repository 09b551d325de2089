"""Whole scans of a folder, labelled by other processes."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bushseg.errors import BushsegError, WorkerError
from bushseg.folder_plan import Planned
from bushseg.folder_work import FolderWork, ScanOutcome
from bushseg.jobs import LABEL_SCAN, Outcome, Scheduler
from bushseg.memory import fit, share
from bushseg.room import is_full
from bushseg.scan_jobs import model_files, note_path, read_note
from bushseg.schedulers import run_twice, wait_until_seen


@dataclass(frozen=True, slots=True)
class Due:
    """A scan that isn't done, and the hash of all that its output follows from."""

    it: Planned
    work: str

    @property
    def num_bytes(self) -> int:
        """The scan's size."""
        with suppress(OSError):  # it has gone: the job says so
            return self.it.scan.stat().st_size
        return 0


def label_elsewhere(
    folder: FolderWork, todo: Mapping[int, Due], scheduler: Scheduler, place: Path
) -> Iterator[tuple[int, ScanOutcome]]:
    """Have other processes label scans, from path to path.

    Args:
        folder: How they are to be labelled.
        todo: The scans, by their places in the plan.
        scheduler: Has them labelled.
        place: For what the jobs need and leave (:func:`bushseg.schedulers.jobs_folder`).

    Yields:
        Places in the plan and what became of those scans, as they end. What is missing was left
        since the disk is full.

    Raises:
        ConfigError: The memory to keep within is too little for so many processes.
        WorkerError: There are no other processes.
        WriteError: The journal can't be written.
    """
    jobs = _jobs(folder, todo, place)
    folder.journal.begin({due.it.name: due.work for due in todo.values()})
    folder.progress.start("labelling", len(jobs), "scans")
    for number, ended in run_twice(scheduler, LABEL_SCAN, jobs):
        it = todo[number].it
        try:
            outcome = _take_up(folder, number, todo[number], ended, place)
        except (BushsegError, OSError) as error:
            if is_full(error):
                scheduler.stop()
            message = str(error)
            for path in (it.scan, it.output):  # as the user knows them
                message = message.replace(str(path.absolute()), str(path))
            outcome = ScanOutcome(it.scan, it.output, "failed", message)
        folder.progress.advance(1)
        yield number, outcome


def _jobs(folder: FolderWork, todo: Mapping[int, Due], place: Path) -> dict[int, dict[str, Any]]:
    """The largest scans come first, lest one of them keeps all waiting at the end."""
    config = folder.config
    settings = config.model_dump(
        mode="json", exclude={"workers", "scheduler", "insecure_scheduler"}
    )
    if config.max_memory is not None:
        fit(config.max_memory, config.workers)
        settings["max_memory"] = share(config.max_memory, config.workers)
    if config.scratch is not None:
        settings["scratch"] = str(config.scratch.absolute())
    shared = {
        "folder": str(place.absolute()),
        "models": model_files(folder.known, place),
        "settings": settings,
        "overwrite": folder.overwrite,
        "verify": folder.verify,
    }
    return {
        number: {
            **shared,
            "number": number,
            "scan": str(due.it.scan.absolute()),
            "output": str(due.it.output.absolute()),
        }
        for number, due in sorted(todo.items(), key=lambda item: -item[1].num_bytes)
    }


def _take_up(folder: FolderWork, number: int, due: Due, ended: Outcome, place: Path) -> ScanOutcome:
    """What a job has left, noted in the journal."""
    it = due.it
    if ended.error is not None:
        raise WorkerError(ended.error)
    if ended.death is not None:
        raise WorkerError(
            f"{it.scan}: its worker was lost twice ({ended.death}); make memory free, then start "
            "the same command again"
        )
    wait_until_seen(note_path(place, number))
    note = read_note(place, number)
    if note.difference is not None:
        folder.refuse(it, note.difference)
    folder.journal.finish(it.name, due.work, note.file)
    result = replace(note.result, input=it.scan, output=it.output)
    return ScanOutcome(it.scan, it.output, "done", result=result)
