"""Whole scans labelled by other processes: to the same bytes, whatever becomes of those."""

import errno
import shutil
from functools import partial
from pathlib import Path

import pytest

from bushseg import folder_prediction, scan_jobs
from bushseg.config import PredictConfig
from bushseg.errors import ConfigError, WriteError
from bushseg.file_labelling import label_file
from bushseg.folder_prediction import FolderResult, predict_folder
from bushseg.jobs import LABEL_SCAN, LABEL_TILE, run_job
from bushseg.memory import share
from bushseg.scan_jobs import note_path
from bushseg.schedulers import JOBS_FOLDER

SMALL = {"tile_points": 1000, "halo": 16}


@pytest.fixture
def use(in_turn):
    """Have folders labelled by a scheduler that does it here."""
    return partial(in_turn, folder_prediction)


@pytest.fixture
def some(scans: Path, new_scene, write_las, tmp_path: Path) -> Path:
    """Three scans, one of them large, and a broken one."""
    folder = tmp_path / "scans"
    (folder / "deep").mkdir(parents=True)
    shutil.copy(scans / "north.las", folder / "north.las")
    shutil.copy(scans / "south.las", folder / "deep" / "south.las")
    write_las(folder / "large.laz", new_scene(4, 6000))
    (folder / "broken.las").write_bytes((scans / "middle.las").read_bytes()[:500])
    return folder


def outputs(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): path.read_bytes() for path in files if path.suffix != ".json"
    }


def told(result: FolderResult, folder: Path) -> list[tuple[object, ...]]:
    """All that a result says but for times and memory."""
    found = []
    for scan in result.scans:
        it = scan.result
        said = it and (it.model, it.reason, it.num_points, it.class_counts, it.num_unlabelled)
        more = it and (it.num_voxels, it.features, it.warnings, it.input, set(it.stages))
        place = scan.output.relative_to(folder)
        found.append((scan.input, place, scan.status, scan.error, said, more))
    return found


def test_processes_come_to_what_one_does(some, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # paths are told as they were given
    some, alone, output = Path("scans"), Path("alone"), Path("out")
    config = PredictConfig(**SMALL)
    expected = predict_folder(some, alone, run, config, verify=True)
    assert [scan.status for scan in expected.scans] == ["failed", "done", "done", "done"]
    config = PredictConfig(**SMALL, workers=2)
    result = predict_folder(some, output, run, config, verify=True)
    assert told(result, output) == told(expected, alone)
    assert outputs(output) == outputs(alone)
    assert sorted(path.name for path in output.iterdir()) == [
        ".bushseg.json",
        "deep",
        "large.laz",
        "north.las",
    ]
    again = predict_folder(some, output, run, PredictConfig(**SMALL))
    assert [scan.status for scan in again.scans] == ["failed", "skipped", "skipped", "skipped"]


def test_the_largest_scan_comes_first_and_what_is_done_is_no_job(some, run, tmp_path, use):
    (some / "broken.las").unlink()
    predict_folder(some / "north.las", tmp_path / "out", run)
    scheduler = use()
    notes: list[str] = []

    class Notes:
        def start(self, stage: str, total: int | None, unit: str) -> None:
            notes.append(f"{stage} {total} {unit}")

        def advance(self, amount: int) -> None:
            assert amount == 1

        def note(self, message: str) -> None:
            notes.append(message.split(" in ")[0])

    predict_folder(some, tmp_path / "out", run, progress=Notes())
    sizes = {path.name: path.stat().st_size for path in some.rglob("*.la?")}
    assert scheduler.names() == sorted(("south.las", "large.laz"), key=sizes.get, reverse=True)
    assert {name for name, _ in scheduler.done} == {LABEL_SCAN}
    assert notes[0] == f"[1 of 3] {tmp_path / 'out' / 'north.las'}: done before"
    assert notes[1] == "labelling 2 scans"
    assert [note[:8] for note in notes[2:]] == ["[2 of 3]", "[3 of 3]"]


def test_fewer_scans_than_processes_are_shared_out_by_tiles(some, run, tmp_path, use):
    scheduler = use(size=4)
    config = PredictConfig(**SMALL)
    result = predict_folder([some / "north.las", some / "large.laz"], tmp_path / "out", run, config)
    assert result.complete
    assert {name for name, _ in scheduler.done} == {LABEL_TILE}
    assert not list((tmp_path / "out").glob(f"{JOBS_FOLDER}*"))


def test_a_model_in_memory_goes_by_a_file(some, model, tmp_path, use):
    scheduler = use(size=1)
    predict_folder(some, tmp_path / "out", model)
    (told,) = scheduler.done[0][1]["models"]
    assert told["name"] == str(model.path)
    assert Path(told["path"]).parents[1] == tmp_path / "out" / JOBS_FOLDER
    use(size=9)
    predict_folder(some, tmp_path / "alone", model)
    assert outputs(tmp_path / "out") == outputs(tmp_path / "alone")


def test_memory_is_shared_out(some, run, tmp_path, use):
    scheduler = use()
    config = PredictConfig(max_memory=4_000_000_000, workers=2, scratch=tmp_path / "scratch")
    predict_folder(some, tmp_path / "out", run, config)
    settings = scheduler.done[0][1]["settings"]
    assert settings["max_memory"] == share(4_000_000_000, 2) == 1_650_000_000
    assert settings["scratch"] == str(tmp_path / "scratch")
    assert not {"workers", "scheduler"} & set(settings)
    config = PredictConfig(max_memory=2_000_000_000, workers=2)
    with pytest.raises(ConfigError, match="labelling in 2 processes takes at least"):
        predict_folder(some, tmp_path / "two", run, config)


def by_name(result: FolderResult) -> dict[str, str]:
    return {scan.input.name: scan.error or scan.status for scan in result.scans}


def test_a_scan_that_kills_twice_fails_and_the_others_are_done(some, run, tmp_path, use):
    scheduler = use("north.las", "north.las", "south.las")
    found = by_name(predict_folder(some, tmp_path / "out", run))
    assert found["north.las"] == (
        f"{some / 'north.las'}: its worker was lost twice (SIGKILL); make memory free, then start "
        "the same command again"
    )
    assert found["broken.las"].startswith(str(some / "broken.las"))
    assert found["south.las"] == found["large.laz"] == "done"
    assert sorted(scheduler.names()[4:]) == ["north.las", "south.las"]
    assert scheduler.num_ended == 2  # each was alone
    use(size=9)
    found = by_name(predict_folder(some, tmp_path / "out", run))
    assert (found["north.las"], found["south.las"]) == ("done", "skipped")


def label_unsaid(name, job):
    """Label a scan without a word on what was done."""
    model = job["models"][0]["path"]
    label_file(job["scan"], job["output"], model, PredictConfig(), None)
    note_path(Path(job["folder"]), job["number"]).touch()


@pytest.mark.parametrize("dying", [run_job, label_unsaid])
def test_a_process_that_dies_when_its_output_stands(some, run, tmp_path, use, monkeypatch, dying):
    (some / "broken.las").unlink()
    called = []

    def count(scan, *rest, **more):
        called.append(Path(scan).name)
        return label_file(scan, *rest, **more)

    monkeypatch.setattr(scan_jobs, "label_file", count)
    use("north.las", dying=dying)
    result = predict_folder(some, tmp_path / "out", run, verify=True)
    assert set(by_name(result).values()) == {"done"}
    assert called.count("north.las") == 1
    assert predict_folder(some, tmp_path / "out", run).count("skipped") == 3


def test_an_output_that_is_not_its_scan(some, run, tmp_path, use, monkeypatch):
    def spoil(scan, written, *rest, **more):
        done = label_file(scan, written, *rest, **more)
        raw = bytearray(Path(written).read_bytes())
        raw[-100] ^= 1
        Path(written).write_bytes(raw)
        return done

    monkeypatch.setattr(scan_jobs, "label_file", spoil)
    use(size=1)
    some = [some / "north.las", some / "deep" / "south.las"]
    found = by_name(predict_folder(some, tmp_path / "out", run, verify=True))
    assert all("differs from" in said for said in found.values())
    found = by_name(predict_folder(some, tmp_path / "out", run))  # they aren't taken for done
    assert all("exists already" in said for said in found.values())


def test_a_full_disk_ends_it(some, run, tmp_path, use, monkeypatch):
    def full(*_, **__):
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise WriteError("out.las: can't be written") from error

    monkeypatch.setattr(scan_jobs, "label_file", full)
    scheduler = use()
    result = predict_folder(some, tmp_path / "out", run)
    assert sorted(scan.status for scan in result.scans) == ["failed", "left", "left", "left"]
    assert "out.las: can't be written (No space left on device)" in by_name(result).values()
    assert len(scheduler.done) == 1


def test_processes_that_are_killed(some, run, tmp_path, deadly_workers):
    deadly_workers(LABEL_SCAN, "scan", "north.las")
    found = by_name(predict_folder(some, tmp_path / "out", run, PredictConfig(workers=2)))
    assert "its worker was lost twice (SIGKILL" in found["north.las"]
    assert found["south.las"] == found["large.laz"] == "done"
    assert not (tmp_path / "out" / JOBS_FOLDER).exists()
