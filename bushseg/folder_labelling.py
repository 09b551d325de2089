"""The scans of a folder, labelled: one after the other, or at once by other processes."""

from collections.abc import Iterator, Mapping, Sequence

from bushseg.errors import BushsegError
from bushseg.file_labelling import label_file
from bushseg.folder_jobs import Due, label_elsewhere
from bushseg.folder_plan import Planned
from bushseg.folder_work import FolderWork, ScanOutcome
from bushseg.jobs import Scheduler
from bushseg.room import is_full
from bushseg.schedulers import jobs_folder
from bushseg.verification import verify as prove


def label_scans(
    folder: FolderWork, plan: Sequence[Planned], scheduler: Scheduler | None
) -> Iterator[tuple[int, ScanOutcome]]:
    """Label the scans of a folder.

    Whole scans are given to other processes if there are enough to keep all of those busy; else the
    scans' tiles are.

    Args:
        folder: How they are to be labelled.
        plan: The scans and their outputs.
        scheduler: Has work done by other processes; None does it all here.

    Yields:
        Places in the plan and what became of those scans, as they end. What is missing was left
        since the disk is full.

    Raises:
        ConfigError: The memory to keep within is too little for so many processes.
        WorkerError: There are no other processes, or they don't see the folder.
        WriteError: The folder can't be written to.
    """
    if scheduler is None:
        yield from _one_by_one(folder, dict(enumerate(plan)), None)
        return
    todo: dict[int, Due] = {}
    for number, it in enumerate(plan):
        try:
            if (work := folder.due(it)) is None:
                yield number, ScanOutcome(it.scan, it.output, "skipped")
            else:
                todo[number] = Due(it, work)
        except (BushsegError, OSError) as error:
            yield number, ScanOutcome(it.scan, it.output, "failed", str(error))
    if len(todo) > 1:
        with jobs_folder(folder.folder) as place:
            scheduler.check(place)
            if len(todo) >= scheduler.size:
                yield from label_elsewhere(folder, todo, scheduler, place)
                return
    yield from _one_by_one(folder, {number: due.it for number, due in todo.items()}, scheduler)


def _one_by_one(
    folder: FolderWork, plan: Mapping[int, Planned], scheduler: Scheduler | None
) -> Iterator[tuple[int, ScanOutcome]]:
    """Label scans one after the other; their tiles may be others' work."""
    for number, it in plan.items():
        try:
            outcome = _label(folder, it, scheduler)
        except (BushsegError, OSError, MemoryError) as error:
            message = str(error) or "out of memory"
            yield number, ScanOutcome(it.scan, it.output, "failed", message)
            if is_full(error):
                return
        else:
            yield number, outcome


def _label(folder: FolderWork, it: Planned, scheduler: Scheduler | None) -> ScanOutcome:
    """Label one scan, unless it is done."""
    if (work := folder.due(it)) is None:
        return ScanOutcome(it.scan, it.output, "skipped")
    folder.journal.begin({it.name: work})
    result = label_file(
        it.scan,
        it.output,
        folder.known,
        folder.config,
        scheduler,
        overwrite=folder.overwrite,
        progress=folder.progress,
    )
    if folder.verify:
        proof = prove(it.scan, it.output, progress=folder.progress)
        if not proof.equal:
            folder.refuse(it, proof.differences[0])
    folder.journal.finish(it.name, work)
    return ScanOutcome(it.scan, it.output, "done", result=result)
