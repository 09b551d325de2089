"""Stand-ins for those who do jobs: a scheduler that does them here, workers that die of them."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from bushseg import worker_pool
from bushseg.jobs import Outcome, run_job


class InTurn:
    """A scheduler that does jobs here, one after the other, and dies of some scans.

    Attributes:
        size: How many it says that it does at once.
        done: The jobs it was given, by name and arguments.
        found: Whether the folder was there, each time it was asked whether it can work in one.
        num_ended: How often idle workers were to end.
    """

    def __init__(self, deadly: tuple[str, ...], size: int, dying: Callable[..., object]) -> None:
        self.size, self.num_ended = size, 0
        self.done: list[tuple[str, dict[str, Any]]] = []
        self.found: list[bool] = []
        self._deadly, self._dying, self._is_stopped = list(deadly), dying, False

    def check(self, folder: Path) -> None:
        self.found.append(folder.is_dir())

    def run(
        self, name: str, jobs: Mapping[int, Mapping[str, Any]]
    ) -> Iterator[tuple[int, Outcome]]:
        self._is_stopped = False
        for number, arguments in jobs.items():
            if self._is_stopped:
                break
            plain = json.loads(json.dumps(arguments))
            self.done.append((name, plain))
            if (scan := Path(plain.get("scan", "")).name) in self._deadly:
                self._deadly.remove(scan)
                self._dying(name, plain)
                yield number, Outcome(death="SIGKILL")
            else:
                yield number, Outcome(error=run_job(name, plain))

    def stop(self) -> None:
        self._is_stopped = True

    def end_idle(self) -> None:
        self.num_ended += 1

    def names(self) -> list[str]:
        return [Path(arguments["scan"]).name for _, arguments in self.done]


@pytest.fixture
def in_turn(monkeypatch: pytest.MonkeyPatch) -> Callable[..., InTurn]:
    """Have the jobs that a module gives out done here.

    It dies once of each mention of a scan among `deadly`, by its file name, after `dying` was
    called with the job.
    """

    def use(
        module: ModuleType,
        *deadly: str,
        size: int = 2,
        dying: Callable[..., object] = lambda *_: None,
    ) -> InTurn:
        scheduler = InTurn(deadly, size, dying)

        @contextmanager
        def opened(*_: object, **__: object) -> Iterator[InTurn]:
            yield scheduler

        monkeypatch.setattr(module, "opened", opened)
        return scheduler

    return use


@pytest.fixture
def start_workers_as(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Have workers run a program of ours, which stands in `tmp_path`."""

    def use(program: str) -> None:
        (tmp_path / "stand_in_worker.py").write_text(program)
        monkeypatch.setattr(worker_pool, "_PROGRAM", "stand_in_worker")
        monkeypatch.syspath_prepend(str(tmp_path))

    return use


_DEADLY = """
import os, signal, sys
from importlib import import_module
from pathlib import Path
from bushseg.jobs import JOBS

module, _, function = JOBS[{job!r}].partition(":")
module = import_module(module)

def work(**arguments):
    name = Path(str(arguments[{key!r}])).name
    with open(Path(__file__).with_name("tries"), "a") as file:
        file.write(f"{{name}} {{'torch' in sys.modules}}\\n")
    if name == {deadly!r} and Path(__file__).with_name("deadly").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    getattr(module, function)(**arguments)

JOBS[{job!r}] = "__main__:work"
from bushseg.worker import main
main()
"""


@pytest.fixture
def deadly_workers(tmp_path: Path, start_workers_as: Callable[[str], None]) -> Callable[..., Path]:
    """Have workers killed by one of the jobs of a kind, for as long as a file is there: this one.

    Beside it, `tries` gets a line for each job that is begun: its value of `key`, and whether
    PyTorch was imported.
    """

    def use(job: str, key: str, deadly: str) -> Path:
        start_workers_as(_DEADLY.format(job=job, key=key, deadly=deadly))
        (tmp_path / "deadly").touch()
        return tmp_path / "deadly"

    return use
