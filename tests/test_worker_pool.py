"""Worker processes: what they did, and that they may die of it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bushseg import worker_pool
from bushseg.errors import WorkerError
from bushseg.jobs import Outcome
from bushseg.schedulers import run_twice
from bushseg.worker_pool import WorkerPool

# A worker whose one job is told by its arguments.
PROGRAM = """
import os, signal, time
from pathlib import Path
import bushseg.jobs
from bushseg.errors import CacheError
from bushseg.parallel import num_workers

def work(path, deed):
    with open(path, "a") as file:
        file.write(f"{os.getpid()} {num_workers()}\\n")
    if deed == "print":
        print("not an answer", flush=True)
    elif deed == "refuse":
        raise CacheError("there is no such tile")
    elif deed == "kill" or (deed == "kill once" and Path(path).read_text().count("\\n") == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    elif deed == "exit":
        os._exit(3)
    elif deed == "wait":
        time.sleep(600)

bushseg.jobs.JOBS["work"] = work
from bushseg.worker import main
main()
"""


@pytest.fixture
def program(tmp_path, monkeypatch) -> Path:
    (tmp_path / "stand_in_worker.py").write_text(PROGRAM)
    monkeypatch.setattr(worker_pool, "_PROGRAM", "stand_in_worker")
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def jobs(folder: Path, *deeds: str) -> dict[int, dict[str, str]]:
    return {
        number: {"path": str(folder / f"job{number}"), "deed": deed}
        for number, deed in enumerate(deeds)
    }


def test_each_job_is_done_once(program):
    found = dict(WorkerPool(2).run("work", jobs(program, "", "print", "")))
    assert found == dict.fromkeys(range(3), Outcome())
    lines = [(program / f"job{number}").read_text().split() for number in range(3)]
    assert {pid for pid, _ in lines} & {str(os.getpid())} == set()
    share = max(1, len(os.sched_getaffinity(0)) // 2)
    assert {cores for _, cores in lines} == {str(share)}


def test_no_jobs_start_no_process():
    assert list(WorkerPool(2).run("work", {})) == []


def test_a_job_that_kills_its_worker_is_told_and_the_others_finish(program):
    deeds = ("kill", "", "kill once", "")
    found = dict(run_twice(WorkerPool(2), "work", jobs(program, *deeds)))
    assert found == {0: "SIGKILL, as when memory runs out", 1: None, 2: None, 3: None}
    tries = [(program / f"job{number}").read_text().count("\n") for number in range(4)]
    assert tries == [2, 1, 2, 1]


def test_a_refusal_is_one_line_and_not_tried_again(program):
    with pytest.raises(WorkerError, match=r"^there is no such tile$"):
        list(run_twice(WorkerPool(1), "work", jobs(program, "refuse", "")))
    assert (program / "job0").read_text().count("\n") == 1


def test_an_exit_is_told_by_its_status(program):
    assert list(WorkerPool(1).run("work", jobs(program, "exit"))) == [
        (0, Outcome(death="exit status 3"))
    ]


def test_a_program_that_can_not_start_is_said_so(monkeypatch, capfd):
    monkeypatch.setattr(worker_pool, "_PROGRAM", "no_such_program")
    with pytest.raises(WorkerError, match=r"can't start \(exit status 1; it said"):
        list(WorkerPool(2).run("work", {0: {}, 1: {}}))
    assert "no_such_program" in capfd.readouterr().err


def has_ended(pid: int) -> bool:
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        if Path(f"/proc/{pid}/stat").exists() and " Z " in Path(f"/proc/{pid}/stat").read_text():
            return True
        time.sleep(0.05)
    return False


def pid_in(path: Path) -> int:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if path.exists() and path.read_text().endswith("\n"):
            return int(path.read_text().split()[0])
        time.sleep(0.05)
    raise AssertionError(f"{path} was never written")


def test_whoever_leaves_ends_the_workers(program):
    running = WorkerPool(2).run("work", jobs(program, "", "wait"))
    assert next(running) == (0, Outcome())
    pid = pid_in(program / "job1")
    running.close()
    assert has_ended(pid)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_their_parent(number, program):
    code = (
        "import sys\n"
        "from bushseg import worker_pool\n"
        "worker_pool._PROGRAM = 'stand_in_worker'\n"
        "list(worker_pool.WorkerPool(1).run('work', {0: {'path': sys.argv[1], 'deed': 'wait'}}))"
    )
    path = os.pathsep.join(filter(None, sys.path))
    parent = subprocess.Popen(
        [sys.executable, "-c", code, str(program / "job0")],
        env=os.environ | {"PYTHONPATH": path},
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    with parent:
        try:
            pid = pid_in(program / "job0")
            os.killpg(parent.pid, number)
            parent.wait(timeout=30)
        finally:
            parent.kill()
    assert parent.returncode != 0
    assert has_ended(pid)
