"""Work that another process does: a name and plain JSON go in, nothing or a complaint comes out."""

import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from bushseg.errors import BushsegError
from bushseg.tile_jobs import label_tile_job

LABEL_TILE = "label tile"

JOBS: dict[str, Callable[..., None]] = {LABEL_TILE: label_tile_job}
"""Every job there is. Results are files, which appear whole or not at all."""

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


def run_job(name: str, arguments: Mapping[str, Any]) -> str | None:
    """Do a job in this process; jobs of several threads wait for each other.

    Returns:
        None, or why it was refused, one line.

    Raises:
        Exception: Anything that isn't bushseg's own refusal.
    """
    with one_at_a_time:
        try:
            JOBS[name](**arguments)
        except BushsegError as error:
            return str(error)
        except OSError as error:
            return f"{error}; check the disk and its permissions"
    return None
