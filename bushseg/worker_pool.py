"""Worker processes on this machine, each with its share of the cores.

They are told what to do through pipes, in JSON (:mod:`bushseg.worker`). A thread waits for each of
them, so that a worker that dies is known by the job it had.
"""

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from bushseg.errors import WorkerError
from bushseg.jobs import Outcome
from bushseg.parallel import num_workers
from bushseg.worker import READY

_PROGRAM = "bushseg.worker"
_LONGEST_LINE = 1 << 16

Process = subprocess.Popen[bytes]
Job = tuple[int, Mapping[str, Any]]


class WorkerPool:
    """A :class:`bushseg.jobs.Scheduler` that starts processes, and ends them with each run.

    Args:
        size: How many work at once.
    """

    def __init__(self, size: int) -> None:
        self._size = size

    def check(self, folder: Path) -> None:
        """Nothing to check: the processes run where this one runs."""

    def run(
        self, name: str, jobs: Mapping[int, Mapping[str, Any]]
    ) -> Iterator[tuple[int, Outcome]]:
        """As :meth:`bushseg.jobs.Scheduler.run`."""
        size = min(self._size, len(jobs))
        crew = _Crew(name, deque(jobs.items()), max(1, num_workers() // max(1, size)))
        threads: list[threading.Thread] = []
        try:
            for _ in range(size):
                thread = threading.Thread(target=crew.serve, daemon=True)
                thread.start()
                threads.append(thread)
            for _ in range(len(jobs)):
                result = crew.results.get()
                if isinstance(result, BaseException):
                    raise result
                yield result
        finally:
            crew.end(threads)


class _Crew:
    """The processes of one run.

    Args:
        name: Which job they do.
        jobs: What there is to do; threads take from it.
        cores: How many cores each process has.
    """

    def __init__(self, name: str, jobs: deque[Job], cores: int) -> None:
        self.results: queue.SimpleQueue[tuple[int, Outcome] | BaseException] = queue.SimpleQueue()
        self._name, self._jobs, self._cores = name, jobs, cores
        self._lock, self._ended = threading.Lock(), False
        self._processes: list[Process] = []

    def serve(self) -> None:
        """Keep one process at work; a new one takes the place of one that died."""
        process: Process | None = None
        try:
            while self._jobs:
                if process is None:
                    process = self._start()
                with suppress(IndexError):  # another thread took the last one
                    number, arguments = self._jobs.popleft()
                    outcome = _ask(process, self._name, arguments)
                    self.results.put((number, outcome))
                    if outcome.death is not None:
                        process = None
        except BaseException as error:
            self.results.put(error)

    def end(self, threads: list[threading.Thread]) -> None:
        """Kill all processes."""
        with self._lock:
            self._ended = True
            self._jobs.clear()
            for process in self._processes:
                process.kill()
        for thread in threads:
            thread.join()
        for process in self._processes:
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with suppress(OSError):
                        pipe.close()

    def _start(self) -> Process:
        with self._lock:
            if self._ended:
                raise WorkerError("the work was given up")
            process = _start(self._cores)
            self._processes.append(process)
        if (answer := _answer(process)) != READY:
            raise WorkerError(
                f"a worker process can't start ({_death(process)}; it said {answer!r}); see what "
                "it wrote to standard error, or work without --workers"
            )
        return process


def _start(cores: int) -> Process:
    """A process that can import what this one can."""
    path = os.pathsep.join(filter(None, [str(Path(__file__).parents[1]), *sys.path]))
    try:
        return subprocess.Popen(
            # -P: what happens to lie in the current folder isn't imported.
            [sys.executable, "-P", "-m", _PROGRAM, str(cores)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C is for this process to handle
        )
    except OSError as error:
        raise WorkerError(
            f"a worker process can't start ({error.strerror or error}); name fewer --workers"
        ) from error


def _ask(process: Process, name: str, arguments: Mapping[str, Any]) -> Outcome:
    """Have a job done."""
    assert process.stdin is not None
    with suppress(OSError):  # it died: that nothing comes back tells
        process.stdin.write(json.dumps([name, arguments]).encode() + b"\n")
        process.stdin.flush()
    answer = _answer(process)
    if answer is None or isinstance(answer, str):
        return Outcome(error=answer)
    return Outcome(death=_death(process))


def _answer(process: Process) -> Any:
    """What a process says; False if it says nothing any more."""
    stdout: IO[bytes] | None = process.stdout
    assert stdout is not None
    try:
        return json.loads(stdout.readline(_LONGEST_LINE) or b"false")
    except ValueError:
        return False


def _death(process: Process) -> str:
    """How a process ended that has nothing more to say."""
    process.kill()  # nothing happens to one that has ended
    status = process.wait()
    if status >= 0:
        return f"exit status {status}"
    name = f"signal {-status}"
    with suppress(ValueError):
        name = signal.Signals(-status).name
    return f"{name}, as when memory runs out" if -status == 9 else name
