"""A folder of scans as one job: nothing is done twice, and one broken file stops nothing."""

import errno
import shutil
from pathlib import Path

import laspy
import numpy as np
import pytest

from bushseg import folder_labelling, folder_prediction
from bushseg.config import PredictConfig
from bushseg.errors import CheckpointError, SchemeError, WriteError
from bushseg.file_labelling import label_file
from bushseg.folder_prediction import LOCK, predict_folder
from bushseg.locks import locked
from bushseg.prediction import predict_file


@pytest.fixture
def some(scans: Path, tmp_path: Path) -> Path:
    """Three scans, one of them broken, in two folders."""
    folder = tmp_path / "scans"
    (folder / "deep").mkdir(parents=True)
    shutil.copy(scans / "north.las", folder / "north.las")
    shutil.copy(scans / "south.las", folder / "deep" / "south.las")
    (folder / "broken.las").write_bytes((scans / "middle.las").read_bytes()[:500])
    return folder


def statuses(result: folder_prediction.FolderResult) -> dict[str, str]:
    return {scan.input.name: scan.status for scan in result.scans}


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_a_folder_with_a_broken_scan(some, run, scans, tmp_path, monkeypatch):
    output = tmp_path / "out"
    result = predict_folder(some, output, run)
    assert statuses(result) == {"broken.las": "failed", "north.las": "done", "south.las": "done"}
    assert not result.complete
    assert result.num_points == 8000
    assert result.scans[0].error.startswith(str(some / "broken.las"))
    assert files(output) == [".bushseg.json", "deep/south.las", "north.las"]
    predict_file(scans / "south.las", tmp_path / "alone.las", run)
    assert (output / "deep" / "south.las").read_bytes() == (tmp_path / "alone.las").read_bytes()

    # Once more: what is done stays, what was broken and is mended is done.
    shutil.copy(scans / "middle.las", some / "broken.las")
    called = []
    monkeypatch.setattr(
        folder_labelling,
        "label_file",
        lambda scan, *rest, **more: called.append(scan.name) or label_file(scan, *rest, **more),
    )
    before = (output / "north.las").stat().st_mtime_ns
    result = predict_folder([some], output, run)
    assert statuses(result) == {
        "broken.las": "done",
        "north.las": "skipped",
        "south.las": "skipped",
    }
    assert result.complete
    assert called == ["broken.las"]
    assert (output / "north.las").stat().st_mtime_ns == before

    # Other settings: nothing is replaced unasked.
    other = PredictConfig(keep_classification=True)
    result = predict_folder(some / "north.las", output, run, other)
    assert "pass --overwrite" in result.scans[0].error
    assert (output / "north.las").stat().st_mtime_ns == before
    result = predict_folder(some / "north.las", output, run, other, overwrite=True)
    assert statuses(result) == {"north.las": "done"}
    after = laspy.read(output / "north.las")
    truth = laspy.read(some / "north.las")
    np.testing.assert_array_equal(after.classification, truth.classification)
    # The command that was stopped is given again as it was.
    result = predict_folder(some / "north.las", output, run, other, overwrite=True)
    assert statuses(result) == {"north.las": "skipped"}


def test_what_stands_there_is_not_taken_for_an_output(some, run, tmp_path):
    output = tmp_path / "out"
    output.mkdir()
    (output / "north.las").write_text("precious")
    result = predict_folder([some / "north.las"], output, run)
    assert "exists already" in result.scans[0].error
    assert (output / "north.las").read_text() == "precious"


def test_a_scan_that_changed_is_done_again_if_asked(some, run, tmp_path, write_las, new_scene):
    output = tmp_path / "out"
    predict_folder([some / "north.las"], output, run)
    write_las(some / "north.las", new_scene(8, 1000))
    assert predict_folder([some / "north.las"], output, run).scans[0].status == "failed"
    predict_folder([some / "north.las"], output, run, overwrite=True)
    assert len(laspy.read(output / "north.las")) == 1000


def test_the_outputs_are_verified(some, model, tmp_path, monkeypatch):
    output = tmp_path / "out"
    result = predict_folder([some / "north.las"], output, model, verify=True)
    assert statuses(result) == {"north.las": "done"}

    def spoil(scan, written, *rest, **more):
        done = label_file(scan, written, *rest, **more)
        raw = bytearray(written.read_bytes())
        raw[-100] ^= 1
        written.write_bytes(raw)
        return done

    monkeypatch.setattr(folder_labelling, "label_file", spoil)
    result = predict_folder([some / "north.las"], tmp_path / "two", model, verify=True)
    assert "differs from" in result.scans[0].error
    monkeypatch.undo()
    result = predict_folder([some / "north.las"], tmp_path / "two", model)
    assert statuses(result) == {"north.las": "failed"}  # it isn't taken for done


def test_a_full_disk_ends_it(some, model, tmp_path, monkeypatch):
    def full(*_, **__):
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise WriteError("out.las: No space left on device") from error

    monkeypatch.setattr(folder_labelling, "label_file", full)
    result = predict_folder(some, tmp_path / "out", model)
    assert [scan.status for scan in result.scans] == ["failed", "left", "left"]
    assert not result.complete


def test_what_can_t_be_begun(some, model, tmp_path):
    with pytest.raises(CheckpointError, match="no such model"):
        predict_folder(some, tmp_path / "out", "nowhere")
    with pytest.raises(SchemeError, match="shrub"):
        predict_folder(some, tmp_path / "out", model, PredictConfig(asprs={"shrub": 4}))
    assert not (tmp_path / "out").exists()
    with locked(tmp_path / "out", LOCK), pytest.raises(WriteError, match="at work here"):
        predict_folder(some, tmp_path / "out", model)
