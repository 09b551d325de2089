"""What predict_file refuses, and that it leaves nothing half done."""

import gc
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from bushseg.config import PredictConfig
from bushseg.errors import DataError, ReadError, SchemeError, WriteError
from bushseg.io import kept
from bushseg.prediction import predict_file


@pytest.fixture
def south(scans) -> Path:
    return scans / "south.las"


@pytest.mark.parametrize(("mapping", "word"), [({"shrub": 4}, "shrub"), ({"bush": 256}, "256")])
def test_a_mapping_that_can_t_be(model, tmp_path, mapping, word):
    """Said before the scan is even opened."""
    with pytest.raises(SchemeError, match=word):
        predict_file(
            tmp_path / "none.las", tmp_path / "out.las", model, PredictConfig(asprs=mapping)
        )


def test_a_missing_feature_is_named(model, new_scene, tmp_path):
    strict = replace(model, card=model.card.model_copy(update={"optional_features": ()}))
    np.savetxt(tmp_path / "bare.xyz", new_scene(0, 500).xyz)
    with pytest.raises(DataError, match=r"needs rgb, intensity, height, the scan has height"):
        predict_file(tmp_path / "bare.xyz", tmp_path / "out.las", strict)
    assert not (tmp_path / "out.las").exists()


def test_a_foreign_scan_is_labelled_with_warnings(model, new_scene, tmp_path):
    np.savetxt(tmp_path / "bare.xyz", 10 * new_scene(0, 500).xyz)
    result = predict_file(tmp_path / "bare.xyz", tmp_path / "out.las", model)
    sparse, tall = result.warnings
    assert "above its ground" in tall
    assert result.features == ("height",)
    assert "sparser" in sparse
    assert len(laspy.read(tmp_path / "out.las")) == 500


def test_the_input_is_never_the_output(model, south, tmp_path):
    before = south.read_bytes()
    link = tmp_path / "link.las"
    link.symlink_to(south)
    for output in (south, link):
        with pytest.raises(WriteError, match="input itself"):
            predict_file(south, output, model, overwrite=True)
    assert south.read_bytes() == before


def test_the_true_labels_beside_a_frame_are_not_overwritten(height_model, new_scene, tmp_path):
    rows = np.column_stack([new_scene(0, 100).xyz, np.ones(100)]).astype("<f4")
    rows.tofile(tmp_path / "frame.bin")
    truth = tmp_path / "frame.label"
    np.ones(100, "<u4").tofile(truth)
    with pytest.raises(WriteError, match="input itself"):
        predict_file(tmp_path / "frame.bin", truth, height_model, overwrite=True)
    assert (np.fromfile(truth, "<u4") == 1).all()


def test_an_existing_output_needs_overwrite(model, south, tmp_path):
    output = tmp_path / "out.las"
    output.write_text("precious")
    with pytest.raises(WriteError, match="--overwrite"):
        predict_file(south, output, model)
    assert output.read_text() == "precious"
    predict_file(south, output, model, overwrite=True)
    assert len(laspy.read(output)) == len(laspy.read(south))


@pytest.mark.parametrize("name", ["out.e57", "out", "out.copc.laz", "out.docx"])
def test_a_format_that_can_t_be_written(model, tmp_path, name):
    """Said before the scan is even opened."""
    with pytest.raises(WriteError):
        predict_file(tmp_path / "none.las", tmp_path / name, model)


def test_failing_half_way_leaves_nothing(model, south, tmp_path, monkeypatch):
    from bushseg.io.las_writer import LasWriter

    def fail(self, *args):
        raise WriteError("the disk is full")

    monkeypatch.setattr(LasWriter, "write", fail)
    output = tmp_path / "out.las"
    output.write_text("precious")
    with pytest.raises(WriteError, match="disk is full"):
        predict_file(south, output, model, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["out.las"]
    assert output.read_text() == "precious"


@pytest.mark.parametrize("suffix", [".las", ".ply"])
def test_a_scan_that_breaks_off_while_written_leaves_nothing(model, south, tmp_path, suffix):
    """Damage that shows on the second pass only: the output's own files are let go of as well."""
    from bushseg.io.las_reader import LasReader

    passes = 0
    honest = LasReader.chunks

    def break_off(self, size=500):
        nonlocal passes
        passes += 1
        for chunk in honest(self, size):
            yield chunk
            if passes == 2:
                raise ReadError(south, "a bad sector", "a disk that works")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kept, "KEPT_BYTES", 0)
        patch.setattr(LasReader, "chunks", break_off)
        with pytest.raises(ReadError, match="bad sector"):
            predict_file(south, tmp_path / f"out{suffix}", model)
    assert passes == 2
    gc.collect()  # a file still open would warn, which is an error here
    assert list(tmp_path.iterdir()) == []


def test_a_truncated_scan_leaves_nothing(model, south, tmp_path):
    short = tmp_path / "short.las"
    short.write_bytes(south.read_bytes()[:-1000])
    with pytest.raises(ReadError, match=r"short\.las"):
        predict_file(short, tmp_path / "out.las", model)
    assert [path.name for path in tmp_path.iterdir()] == ["short.las"]


def test_a_scan_that_grows_meanwhile(height_model, new_scene, tmp_path, monkeypatch):
    from bushseg import file_labelling

    path = tmp_path / "scan.xyz"
    np.savetxt(path, new_scene(0, 300).xyz, fmt="%.3f")
    honest = file_labelling.label_voxels

    def meddle(*args):
        labels = honest(*args)
        with path.open("a") as file:
            file.write("1 2 3\n")
        return labels

    monkeypatch.setattr(file_labelling, "label_voxels", meddle)
    # A scan this small is written as it was read.
    assert predict_file(path, tmp_path / "out.ply", height_model).num_points == 300
    monkeypatch.setattr(kept, "KEPT_BYTES", 0)
    with pytest.raises(ReadError):
        predict_file(path, tmp_path / "again.ply", height_model)
    assert not (tmp_path / "again.ply").exists()
