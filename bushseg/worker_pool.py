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
from typing import IO, Any, Self

from bushseg.errors import WorkerError
from bushseg.jobs import Outcome
from bushseg.parallel import num_workers
from bushseg.worker import READY

_PROGRAM = "bushseg.worker"
_LONGEST_LINE = 1 << 16

Process = subprocess.Popen[bytes]
Job = tuple[int, Mapping[str, Any]]


class WorkerPool:
    """A :class:`bushseg.jobs.Scheduler` that starts processes, and keeps them from run to run.

    Those that a run finds at work when it is left are killed; those that idle go on to the next
    run, until the pool is closed, as it is where a `with` block ends.

    Args:
        size: How many work at once.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._idle: list[Process] = []
        self._crew: _Crew | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end_idle()

    def check(self, folder: Path) -> None:
        """Nothing to check: the processes run where this one runs."""

    def run(
        self, name: str, jobs: Mapping[int, Mapping[str, Any]]
    ) -> Iterator[tuple[int, Outcome]]:
        """As :meth:`bushseg.jobs.Scheduler.run`."""
        size = min(self.size, len(jobs))
        cores = max(1, num_workers() // max(1, size))
        crew = self._crew = _Crew(name, deque(jobs.items()), cores, self._idle)
        try:
            crew.begin(size)
            while crew.num_expected:
                result = crew.results.get()
                if isinstance(result, BaseException):
                    raise result
                crew.num_expected -= 1
                yield result
            crew.join()
        finally:
            crew.end()

    def stop(self) -> None:
        """As :meth:`bushseg.jobs.Scheduler.stop`."""
        if self._crew is not None:
            self._crew.drop()

    def end_idle(self) -> None:
        """As :meth:`bushseg.jobs.Scheduler.end_idle`."""
        while self._idle:
            _end(self._idle.pop())


class _Crew:
    """The processes of one run.

    Args:
        name: Which job they do.
        jobs: What there is to do; threads take from it.
        cores: How many cores each process has.
        idle: Processes to begin with, and where those go that have nothing more to do.
    """

    def __init__(self, name: str, jobs: deque[Job], cores: int, idle: list[Process]) -> None:
        self.results: queue.SimpleQueue[tuple[int, Outcome] | BaseException] = queue.SimpleQueue()
        self.num_expected = len(jobs)
        self._name, self._jobs, self._cores, self._idle = name, jobs, cores, idle
        self._lock, self._ended = threading.Lock(), False
        self._threads: list[threading.Thread] = []
        self._at_work: set[Process] = set()

    def begin(self, size: int) -> None:
        """Start threads, each of which keeps one process at work."""
        for _ in range(size):
            thread = threading.Thread(target=self._serve, daemon=True)
            thread.start()
            self._threads.append(thread)

    def drop(self) -> None:
        """Give out no more jobs."""
        with suppress(IndexError):
            while True:
                self._jobs.pop()
                self.num_expected -= 1

    def join(self) -> None:
        """Wait until all processes idle; those that are only just starting are waited for."""
        for thread in self._threads:
            thread.join()

    def end(self) -> None:
        """Kill the processes that are still at work."""
        with self._lock:
            self._ended = True
            self._jobs.clear()
            for process in self._at_work:
                process.kill()
        self.join()
        for process in self._at_work:
            _end(process)

    def _serve(self) -> None:
        """Keep one process at work; a new one takes the place of one that died."""
        process: Process | None = None
        try:
            while self._jobs:
                process = process or self._take()
                with suppress(IndexError):  # another thread took the last one
                    number, arguments = self._jobs.popleft()
                    outcome = _ask(process, self._name, arguments, self._cores)
                    if outcome.death is not None:
                        self._leave(process, is_alive=False)
                        process = None
                    self.results.put((number, outcome))
            if process is not None:
                self._leave(process, is_alive=True)
        except BaseException as error:
            self.results.put(error)

    def _take(self) -> Process:
        """A process that idles, or a new one."""
        while True:
            with self._lock:
                if self._ended:
                    raise WorkerError("the work was given up")
                is_new = not self._idle
                process = _start() if is_new else self._idle.pop()
                self._at_work.add(process)
            if not is_new:
                # One that was killed may be a while in ending, and its next job would be blamed.
                _tell(process, None)
            if (answer := _answer(process)) == READY:
                return process
            if is_new:
                raise WorkerError(
                    f"a worker process can't start ({_death(process)}; it said {answer!r}); see "
                    "what it wrote to standard error, or work without --workers"
                )
            self._leave(process, is_alive=False)

    def _leave(self, process: Process, *, is_alive: bool) -> None:
        """Have no more to do with a process; one that may have been killed is left to `end`."""
        with self._lock:
            if self._ended:
                return
            self._at_work.remove(process)
            if is_alive:
                self._idle.append(process)
        if not is_alive:
            _end(process)


def _start() -> Process:
    """A process that can import what this one can."""
    path = os.pathsep.join(filter(None, [str(Path(__file__).parents[1]), *sys.path]))
    try:
        return subprocess.Popen(
            # -P: what happens to lie in the current folder isn't imported.
            [sys.executable, "-P", "-m", _PROGRAM],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": path},
            start_new_session=True,  # Ctrl-C is for this process to handle
        )
    except OSError as error:
        raise WorkerError(
            f"a worker process can't start ({error.strerror or error}); name fewer --workers"
        ) from error


def _ask(process: Process, name: str, arguments: Mapping[str, Any], cores: int) -> Outcome:
    """Have a job done, on so many cores."""
    _tell(process, [name, arguments, cores])
    answer = _answer(process)
    if answer is None or isinstance(answer, str):
        return Outcome(error=answer)
    return Outcome(death=_death(process))


def _tell(process: Process, what: Any) -> None:
    """Say something to a process; if it died, that nothing comes back tells."""
    assert process.stdin is not None
    with suppress(OSError):
        process.stdin.write(json.dumps(what).encode() + b"\n")
        process.stdin.flush()


def _answer(process: Process) -> Any:
    """What a process says; False if it says nothing any more."""
    stdout: IO[bytes] | None = process.stdout
    assert stdout is not None
    try:
        return json.loads(stdout.readline(_LONGEST_LINE) or b"false")
    except ValueError:
        return False


def _end(process: Process) -> None:
    """Kill a process, and leave nothing of it."""
    process.kill()  # nothing happens to one that has ended
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()


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
