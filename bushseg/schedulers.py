"""Who does the jobs: this process, worker processes beside it, or a Dask cluster."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from bushseg.config import PredictConfig
from bushseg.errors import ConfigError, WorkerError
from bushseg.jobs import Scheduler
from bushseg.worker_pool import WorkerPool


@contextmanager
def opened(config: PredictConfig) -> Iterator[Scheduler | None]:
    """The scheduler that is set, ready to work; None where this process does everything itself.

    Raises:
        ConfigError: The address isn't one that may be used, or workers are set as well.
        WorkerError: Dask isn't installed, or nobody answers at the address.
    """
    if config.scheduler is not None and config.workers > 1:
        raise ConfigError("workers and scheduler are both set; name one of them")
    if config.scheduler is not None:
        from bushseg.cluster import connected

        with connected(config.scheduler, insecure=config.insecure_scheduler) as scheduler:
            yield scheduler
    else:
        yield WorkerPool(config.workers) if config.workers > 1 else None


def run_twice(
    scheduler: Scheduler, name: str, jobs: Mapping[int, Mapping[str, Any]]
) -> Iterator[tuple[int, str | None]]:
    """Have each job done; one whose process dies is done once more, alone, when the others are.

    Alone: it may have been the others that left it no memory.

    Args:
        scheduler: Who does them.
        name: Which of :data:`bushseg.jobs.JOBS`.
        jobs: A job's number and its arguments.

    Yields:
        Numbers as they end, and None, or how the process ended the second time.

    Raises:
        WorkerError: A job was refused, or nobody does them.
    """
    again = []
    for number, outcome in scheduler.run(name, jobs):
        if outcome.error is not None:
            raise WorkerError(outcome.error)
        if outcome.death is not None:
            again.append(number)
        else:
            yield number, None
    for number in sorted(again):
        for _, outcome in scheduler.run(name, {number: jobs[number]}):
            if outcome.error is not None:
                raise WorkerError(outcome.error)
            yield number, outcome.death
