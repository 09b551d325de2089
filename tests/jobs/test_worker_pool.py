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
    elif deed == "pause":
        time.sleep(0.2)
    elif deed == "wait":
        time.sleep(600)

bushseg.jobs.JOBS["work"] = "__main__:work"
from bushseg.worker import main
main()
"""


@pytest.fixture
def program(tmp_path, start_workers_as) -> Path:
    start_workers_as(PROGRAM)
    return tmp_path


def jobs(folder: Path, *deeds: str) -> dict[int, dict[str, str]]:
    return {
        number: {"path": str(folder / f"job{number}"), "deed": deed}
        for number, deed in enumerate(deeds)
    }


@pytest.fixture
def pool():
    with WorkerPool(2) as pool:
        yield pool


def test_each_job_is_done_once(program, pool):
    found = dict(pool.run("work", jobs(program, "", "print", "")))
    assert found == dict.fromkeys(range(3), Outcome())
    lines = [(program / f"job{number}").read_text().split() for number in range(3)]
    assert {pid for pid, _ in lines} & {str(os.getpid())} == set()
    share = max(1, len(os.sched_getaffinity(0)) // 2)
    assert {cores for _, cores in lines} == {str(share)}


def test_no_jobs_start_no_process(pool):
    assert list(pool.run("work", {})) == []


def test_a_job_that_kills_its_worker_is_told_and_the_others_finish(program, pool):
    deeds = ("kill", "", "kill once", "")
    found = dict(run_twice(pool, "work", jobs(program, *deeds)))
    death = Outcome(death="SIGKILL, as when memory runs out")
    assert found == {0: death, 1: Outcome(), 2: Outcome(), 3: Outcome()}
    tries = [(program / f"job{number}").read_text().count("\n") for number in range(4)]
    assert tries == [2, 1, 2, 1]


def test_a_refusal_is_one_line_and_not_tried_again(program, pool):
    found = dict(run_twice(pool, "work", jobs(program, "refuse", "")))
    assert found == {0: Outcome(error="there is no such tile"), 1: Outcome()}
    assert (program / "job0").read_text().count("\n") == 1


def test_an_exit_is_told_by_its_status(program, pool):
    assert list(pool.run("work", jobs(program, "exit"))) == [(0, Outcome(death="exit status 3"))]


def test_a_program_that_can_not_start_is_said_so(monkeypatch, capfd, pool):
    monkeypatch.setattr(worker_pool, "_PROGRAM", "no_such_program")
    with pytest.raises(WorkerError, match=r"can't start \(exit status 1; it said"):
        list(pool.run("work", {0: {}, 1: {}}))
    assert "no_such_program" in capfd.readouterr().err


def lines(folder: Path) -> list[list[str]]:
    """What the jobs of all runs so far have noted: their process, and its cores."""
    paths = sorted(folder.glob("job*"))
    return [line.split() for path in paths for line in path.read_text().splitlines()]


def test_processes_are_kept_for_the_next_run(program):
    cores = len(os.sched_getaffinity(0))
    with WorkerPool(2) as pool:
        for _ in range(3):
            list(pool.run("work", jobs(program, "", "")))
        used = {pid for pid, _ in lines(program)}
        assert len(used) in (1, 2)
        (program / "job0").unlink()
        list(pool.run("work", jobs(program, "")))  # alone, with all cores
        ((pid, told),) = lines(program)[:1]
        assert (pid in used or len(used) == 1, told) == (True, str(cores))
        # One that died meanwhile is replaced, and nobody blames a job for it.
        os.kill(int(pid), signal.SIGKILL)
        assert has_ended(int(pid))
        assert dict(pool.run("work", jobs(program, "", ""))) == dict.fromkeys(range(2), Outcome())
    assert all(has_ended(int(pid)) for pid, _ in lines(program))


def test_those_that_idle_leave_their_memory(program, pool):
    list(pool.run("work", jobs(program, "", "")))
    pool.end_idle()
    assert has_ended(pid_in(program / "job0"))
    assert dict(pool.run("work", jobs(program, ""))) == {0: Outcome()}


def test_what_is_begun_is_ended_when_a_run_is_stopped(program, pool):
    found = []
    for number, _ in pool.run("work", jobs(program, "", "pause", *20 * ["pause"])):
        found.append(number)
        pool.stop()
    assert {0} < set(found) <= {0, 1, 2, 3}
    begun = {int(path.name.removeprefix("job")) for path in program.glob("job*")}
    assert begun == set(found)


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


def test_whoever_leaves_ends_the_workers(program, pool):
    running = pool.run("work", jobs(program, "", "wait"))
    assert next(running) == (0, Outcome())
    pid = pid_in(program / "job1")
    running.close()
    assert has_ended(pid)
    assert dict(pool.run("work", jobs(program, "", ""))) == dict.fromkeys(range(2), Outcome())


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
