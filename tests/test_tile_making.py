"""Scans made into tiles by other processes: to the same bytes, whatever becomes of those."""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bushseg import tile_making, worker_pool
from bushseg.config import PrepareConfig
from bushseg.errors import ConfigError, WorkerError
from bushseg.jobs import PREPARE_SCAN, Outcome, run_job
from bushseg.memory import fit_table, share
from bushseg.preparation import prepare


class InTurn:
    """A scheduler that does jobs here, one after the other; some scans kill it."""

    def __init__(self, *deadly: str) -> None:
        self.size = 2
        self.done: list[dict[str, Any]] = []
        self._deadly, self._is_stopped = list(deadly), False

    def check(self, folder: Path) -> None:
        assert folder.is_dir()

    def run(
        self, name: str, jobs: Mapping[int, Mapping[str, Any]]
    ) -> Iterator[tuple[int, Outcome]]:
        assert name == PREPARE_SCAN
        for number, arguments in jobs.items():
            if self._is_stopped:
                break
            plain = json.loads(json.dumps(arguments))
            self.done.append(plain)
            if (scan := Path(plain["scan"]).name) in self._deadly:
                self._deadly.remove(scan)
                yield number, Outcome(death="SIGKILL")
            else:
                yield number, Outcome(error=run_job(name, plain))

    def stop(self) -> None:
        self._is_stopped = True

    def end_idle(self) -> None:
        pass

    def names(self) -> list[str]:
        return [Path(arguments["scan"]).name for arguments in self.done]


@pytest.fixture
def use(monkeypatch):
    """Have tiles made by a scheduler."""

    def use(scheduler: InTurn) -> InTurn:
        @contextmanager
        def opened(*_: object, **__: object) -> Iterator[InTurn]:
            yield scheduler

        monkeypatch.setattr(tile_making, "opened", opened)
        return scheduler

    return use


@pytest.fixture
def some(scans: Path, new_scene, write_las, tmp_path: Path, monkeypatch) -> Path:
    """Three scans, one of them large, named as from the current folder."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(scans, "scans", ignore=shutil.ignore_patterns("middle*"))
    write_las(Path("scans/large.laz"), new_scene(4, 6000))
    return Path("scans")


@pytest.fixture
def config(tiny) -> PrepareConfig:
    return tiny().prepare


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_processes_come_to_what_one_does(some, config):
    alone = prepare([some], "alone", config)
    steps: list[str | int] = []

    class Steps:
        def start(self, stage: str, total: int | None, unit: str) -> None:
            steps.append(f"{stage} {total} {unit}")

        def advance(self, amount: int) -> None:
            steps.append(amount)

        def note(self, message: str) -> None:
            raise AssertionError(message)

    result = prepare([some], "out", config, workers=2, progress=Steps())
    assert contents(Path("out")) == contents(Path("alone"))
    assert steps[:4] == ["preparing 3 scans", 1, 1, 1]
    assert "preparing" not in str(steps[4:])
    assert (result.num_redone, result.num_tiles) == (3, alone.num_tiles)
    assert (result.class_counts, result.warnings) == (alone.class_counts, alone.warnings)
    assert set(result.stages) == {"draw crops"}
    again = prepare([some], "out", config, workers=2)
    assert (again.num_redone, again.crops_redone) == (0, False)


def test_what_is_due_is_given_out_the_largest_first(some, config, use):
    prepare([some / "north.las"], "out", config)
    scheduler = use(InTurn())
    prepare([some], "out", config, workers=2, max_memory="3GB")
    sizes = {path.name: path.stat().st_size for path in some.iterdir()}
    assert scheduler.names() == sorted(("south.las", "large.laz"), key=sizes.get, reverse=True)
    job = scheduler.done[0]
    assert job["lean"] is True
    assert job["max_voxels"] == fit_table(share(3 * 10**9, 2), config.tile_points, 7)
    assert job["scan"] == str(Path.cwd() / job["name"])
    assert not list(Path("out").rglob(".*"))


def test_a_broken_scan_ends_it_with_the_line_it_has_in_one_process(some, config, use):
    broken = some / "broken.las"
    broken.write_bytes((some / "north.las").read_bytes()[:-70])
    with pytest.raises(Exception, match=r"scans/broken\.las") as alone:
        prepare([broken], "alone", config)
    scheduler = use(InTurn())
    with pytest.raises(WorkerError) as caught:
        prepare([some], "out", config, workers=2)
    assert str(caught.value) == str(alone.value)
    assert scheduler.names()[-1] == "broken.las"  # nothing was given out afterwards
    broken.unlink()
    scheduler = use(InTurn())
    assert prepare([some], "out", config, workers=2).num_redone == len(scheduler.done) < 3
    prepare([some], "alone", config)
    assert contents(Path("out")) == contents(Path("alone"))


def test_a_job_is_checked_where_it_arrives(some, config, use):
    scheduler = use(InTurn())
    prepare([some / "north.las", some / "south.las"], "out", config, workers=2)
    job = scheduler.done[0]
    assert run_job(PREPARE_SCAN, job) is None  # it is done already
    shutil.rmtree(Path("out/scans") / job["place"])
    for name, value in (("place", "../../scans-0123456789abcdef"), ("max_voxels", 0)):
        assert f"job: {name} is {value!r}" in run_job(PREPARE_SCAN, {**job, name: value})
    assert "more is no known setting" in run_job(PREPARE_SCAN, {**job, "more": 1})
    nowhere = {**job, "scan": "/nowhere/north.las"}
    assert "isn't there for the worker" in run_job(PREPARE_SCAN, nowhere)
    other = {**job, "scan": str((some / "large.laz").absolute())}
    assert "is another file for the worker" in run_job(PREPARE_SCAN, other)
    assert not (Path("out/scans") / job["place"]).exists()


def test_what_does_not_go_together_is_refused(some, config):
    with pytest.raises(ConfigError, match="workers is 0; expected 1 or more"):
        prepare([some], "out", config, workers=0)
    with pytest.raises(ConfigError, match="workers and scheduler are both set"):
        prepare([some], "out", config, workers=2, scheduler="tcp://127.0.0.1:8786")
    with pytest.raises(ConfigError, match=r"another machine without tls"):
        prepare([some], "out", config, scheduler="tcp://192.0.2.1:8786")
    with pytest.raises(ConfigError, match=r"in 2 processes takes at least 1\.\d\d GB.* or fewer"):
        prepare([some], "out", config, workers=2, max_memory="1GB")
    assert not Path("out").exists()


# A scan called north kills whoever reads it, as long as a file says so.
PROGRAM = """
import os, signal, sys
from pathlib import Path
from bushseg import prepare_jobs

prepare_scan = prepare_jobs.prepare_scan_job

def work(scan, **arguments):
    with open(Path(__file__).with_name("tries"), "a") as file:
        file.write(f"{Path(scan).name} {'torch' in sys.modules}\\n")
    if scan.endswith("north.las") and Path(__file__).with_name("deadly").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    prepare_scan(scan=scan, **arguments)

prepare_jobs.prepare_scan_job = work
from bushseg.worker import main
main()
"""


def test_a_scan_that_kills_twice_is_named_and_the_others_are_kept(
    some, config, tmp_path, monkeypatch
):
    (tmp_path / "deadly_worker.py").write_text(PROGRAM)
    (tmp_path / "deadly").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(worker_pool, "_PROGRAM", "deadly_worker")
    with pytest.raises(WorkerError) as caught:
        prepare([some], "out", config, workers=2)
    assert str(caught.value) == (
        f"scans{os.sep}north.las: its worker was lost twice (SIGKILL, as when memory runs out); "
        "2 of 3 scans are done and kept: make memory free, then start the same command again"
    )
    tries = sorted((tmp_path / "tries").read_text().split("\n")[:-1])
    assert tries == [f"{name} False" for name in ("large.laz", *["north.las"] * 2, "south.las")]
    assert len(list(Path("out").glob("scans/*/manifest.json"))) == 2
    assert not Path("out/dataset.json").exists()
    (tmp_path / "deadly").unlink()
    assert prepare([some], "out", config, workers=2).num_redone == 1
    prepare([some], "alone", config)
    assert contents(Path("out")) == contents(Path("alone"))
