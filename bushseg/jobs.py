"""Work that another process does: a name and plain JSON go in, nothing or a complaint comes out."""

import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from bushseg.errors import BushsegError
from bushseg.room import with_reason

LABEL_TILE = "label tile"
LABEL_SCAN = "label scan"
PREPARE_SCAN = "prepare scan"

JOBS = {
    LABEL_TILE: "bushseg.tile_jobs:label_tile_job",
    LABEL_SCAN: "bushseg.scan_jobs:label_scan_job",
    PREPARE_SCAN: "bushseg.prepare_jobs:prepare_scan_job",
}
"""Every job there is: the module that is imported when it is first done, and the function there,
since what does a job may also be what gives jobs out. Results are files, which appear whole or not
at all."""

one_at_a_time = threading.RLock()
"""A job uses all cores that its process may use: those of other threads wait."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a job.

    Attributes:
        error: Why it was refused, one line: doing it again would change nothing. None if it wasn't.
        death: How the process that did it ended. None if it lives.
    """

    error: str | None = None
    death: str | None = None


class Scheduler(Protocol):
    """Has jobs done by other processes."""

    @property
    def size(self) -> int:
        """How many jobs are done at once."""

    def check(self, folder: Path) -> None:
        """Make sure that those processes can work in a folder.

        Raises:
            WorkerError: They can't.
        """

    def run(
        self, name: str, jobs: Mapping[int, Mapping[str, Any]]
    ) -> Iterator[tuple[int, Outcome]]:
        """Have each job done once, as many at a time as there are processes.

        Args:
            name: Which of :data:`JOBS`.
            jobs: A job's number and its arguments.

        Yields:
            Numbers and what became of them, as they end. What hasn't begun when the caller leaves
            is left out.

        Raises:
            WorkerError: There are no processes to do them.
        """

    def stop(self) -> None:
        """Begin no further job of the run that is on; those that were begun go on to their end."""

    def end_idle(self) -> None:
        """Have processes that wait for jobs leave their memory to those at work."""


def load_job(name: str) -> Callable[..., None]:
    """The function of a job, its module imported."""
    module, _, function = JOBS[name].partition(":")
    found: Callable[..., None] = getattr(import_module(module), function)
    return found


def run_job(name: str, arguments: Mapping[str, Any]) -> str | None:
    """Do a job in this process; jobs of several threads wait for each other.

    Returns:
        None, or why it was refused, one line.

    Raises:
        Exception: Anything that isn't bushseg's own refusal.
    """
    with one_at_a_time:
        try:
            load_job(name)(**arguments)
        except BushsegError as error:
            return with_reason(str(error), error)
        except OSError as error:
            return f"{error}; check the disk and its permissions"
    return None
