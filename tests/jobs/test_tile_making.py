"""Scans made into tiles by other processes: to the same bytes, whatever becomes of those."""

import os
import shutil
from functools import partial
from pathlib import Path

import pytest

from bushseg import tile_making
from bushseg.config import PrepareConfig
from bushseg.errors import ConfigError, WorkerError
from bushseg.jobs import PREPARE_SCAN, run_job
from bushseg.memory import fit_table, share
from bushseg.preparation import prepare


@pytest.fixture
def use(in_turn):
    """Have tiles made by a scheduler that does it here."""
    return partial(in_turn, tile_making)


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


def test_processes_come_to_what_one_does(some, config, contents):
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
    scheduler = use()
    prepare([some], "out", config, workers=2, max_memory="3GB")
    sizes = {path.name: path.stat().st_size for path in some.iterdir()}
    assert scheduler.names() == sorted(("south.las", "large.laz"), key=sizes.get, reverse=True)
    name, job = scheduler.done[0]
    assert name == PREPARE_SCAN
    assert scheduler.found == [True]
    assert job["lean"] is True
    assert job["max_voxels"] == fit_table(share(3 * 10**9, 2), config.tile_points, 7)
    assert job["scan"] == str(Path.cwd() / job["name"])
    assert not list(Path("out").rglob(".*"))


def test_a_broken_scan_ends_it_with_the_line_it_has_in_one_process(some, config, use, contents):
    broken = some / "broken.las"
    broken.write_bytes((some / "north.las").read_bytes()[:-70])
    with pytest.raises(Exception, match=r"scans/broken\.las") as alone:
        prepare([broken], "alone", config)
    scheduler = use()
    with pytest.raises(WorkerError) as caught:
        prepare([some], "out", config, workers=2)
    assert str(caught.value) == str(alone.value)
    assert scheduler.names()[-1] == "broken.las"  # nothing was given out afterwards
    broken.unlink()
    scheduler = use()
    assert prepare([some], "out", config, workers=2).num_redone == len(scheduler.done) < 3
    prepare([some], "alone", config)
    assert contents(Path("out")) == contents(Path("alone"))


def test_a_job_is_checked_where_it_arrives(some, config, use):
    scheduler = use()
    prepare([some / "north.las", some / "south.las"], "out", config, workers=2)
    job = scheduler.done[0][1]
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


def test_a_scan_that_kills_twice_is_named_and_the_others_are_kept(
    some, config, deadly_workers, contents
):
    deadly = deadly_workers(PREPARE_SCAN, "scan", "north.las")
    with pytest.raises(WorkerError) as caught:
        prepare([some], "out", config, workers=2)
    assert str(caught.value) == (
        f"scans{os.sep}north.las: its worker was lost twice (SIGKILL, as when memory runs out); "
        "2 of 3 scans are done and kept: make memory free, then start the same command again"
    )
    tries = sorted(deadly.with_name("tries").read_text().split("\n")[:-1])
    assert tries == [f"{name} False" for name in ("large.laz", *["north.las"] * 2, "south.las")]
    assert len(list(Path("out").glob("scans/*/manifest.json"))) == 2
    assert not Path("out/dataset.json").exists()
    deadly.unlink()
    assert prepare([some], "out", config, workers=2).num_redone == 1
    prepare([some], "alone", config)
    assert contents(Path("out")) == contents(Path("alone"))
