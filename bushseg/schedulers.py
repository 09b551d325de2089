"""Who does the jobs: this process, worker processes beside it, or a Dask cluster."""

import secrets
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bushseg.errors import ConfigError, WriteError
from bushseg.jobs import Outcome, Scheduler
from bushseg.worker_pool import WorkerPool

JOBS_FOLDER = ".bushseg-jobs"
"""Within the folder of outputs, while other processes work on its scans."""

_SHARED_FOLDER_DELAY = 60.0  # seconds


@contextmanager
def opened(
    workers: int = 1, address: str | None = None, *, insecure: bool = False
) -> Iterator[Scheduler | None]:
    """A scheduler that is ready to work, for as long as the block takes; its processes end with it.

    Args:
        workers: Processes beside this one; 1 for none.
        address: A Dask scheduler's; None for none.
        insecure: Whether another machine's may be called without TLS.

    Yields:
        The scheduler; None where this process does everything itself.

    Raises:
        ConfigError: The address isn't one that may be used, or workers are set as well.
        WorkerError: Dask isn't installed, or nobody answers at the address.
    """
    if address is not None and workers > 1:
        raise ConfigError("workers and scheduler are both set; name one of them")
    if address is not None:
        from bushseg.cluster import connected

        with connected(address, insecure=insecure) as scheduler:
            yield scheduler
    elif workers > 1:
        with WorkerPool(workers) as pool:
            yield pool
    else:
        yield None


def run_twice(
    scheduler: Scheduler, name: str, jobs: Mapping[int, Mapping[str, Any]]
) -> Iterator[tuple[int, Outcome]]:
    """Have each job done; one whose process dies is done once more, alone, when the others are.

    Alone: it may have been the others that left it no memory.

    Args:
        scheduler: Who does them.
        name: Which of :data:`bushseg.jobs.JOBS`.
        jobs: A job's number and its arguments.

    Yields:
        Numbers as they end, and what became of them at last.

    Raises:
        WorkerError: Nobody does them.
    """
    again = []
    for number, outcome in scheduler.run(name, jobs):
        if outcome.death is None:
            yield number, outcome
        else:
            again.append(number)
    for number in sorted(again):
        scheduler.end_idle()
        yield from scheduler.run(name, {number: jobs[number]})


def wait_until_seen(path: Path) -> None:
    """Wait for a file that another process has just written to be seen here, but not for ever.

    Network file systems remember for a while what isn't there.
    """
    deadline = time.monotonic() + _SHARED_FOLDER_DELAY
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.5)


@contextmanager
def jobs_folder(folder: Path) -> Iterator[Path]:
    """A folder for what jobs need and leave.

    Each run's has its own name: jobs of a run that was killed may still be under way on a cluster.

    Raises:
        WriteError: It can't be made.
    """
    root = folder / JOBS_FOLDER
    place = root / secrets.token_hex(4)
    shutil.rmtree(root, ignore_errors=True)
    try:
        place.mkdir(parents=True)
    except OSError as error:
        raise WriteError(f"{place}: can't write here ({error.strerror or error})") from error
    try:
        yield place
    finally:
        shutil.rmtree(root, ignore_errors=True)
