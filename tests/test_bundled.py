"""The index of bundled models, the shipped one included, and what is said of a damaged one."""

import shutil
from pathlib import Path

import pytest

from bushseg import bundled
from bushseg.bundled import INDEX, MAX_BYTES, bundled_models, bundled_path
from bushseg.checkpoint import read_card
from bushseg.errors import CheckpointError


@pytest.fixture
def copy(stand_ins, tmp_path, monkeypatch) -> Path:
    folder = shutil.copytree(stand_ins, tmp_path / "bundled")
    monkeypatch.setattr(bundled, "FOLDER", folder)
    return folder


def test_what_is_shipped_is_whole_small_and_described():
    """Holds for an empty index too: then only the model card is there."""
    paths = [bundled_path(model) for model in bundled_models()]
    assert sum(path.stat().st_size for path in paths) <= MAX_BYTES
    text = (bundled.FOLDER / "MODEL_CARD.md").read_text(encoding="utf-8")
    for model, path in zip(bundled_models(), paths, strict=True):
        assert read_card(path).prepare.voxel_size == model.voxel_size
        assert model.name in text
        assert model.license in text


def test_no_file_is_shipped_that_the_index_does_not_name():
    named = {model.file for model in bundled_models()}
    assert {path.name for path in bundled.FOLDER.glob("*.safetensors")} == named


def test_finest_voxels_come_first(copy):
    assert [model.name for model in bundled_models()] == ["close", "airborne"]
    assert bundled_path(bundled_models()[0]) == copy / "close.safetensors"


def test_a_changed_file_is_refused(copy):
    path = copy / "close.safetensors"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(
        CheckpointError, match=r"close\.safetensors: has SHA-256 .* install"
    ) as info:
        bundled_path(bundled_models()[0])
    assert "\n" not in str(info.value)


def test_a_missing_file_is_refused(copy):
    (copy / "close.safetensors").unlink()
    with pytest.raises(CheckpointError, match="can't be read"):
        bundled_path(bundled_models()[0])


@pytest.mark.parametrize("text", ["models = [", "models = 3", '[[models]]\nname = "x"', "a = 1"])
def test_an_index_that_is_none(copy, text):
    (copy / INDEX).write_text(text)
    with pytest.raises(CheckpointError, match=r"index\.toml: can't be used"):
        bundled_models()


def test_an_entry_can_not_lead_out_of_the_folder(copy):
    text = (copy / INDEX).read_text()
    (copy / INDEX).write_text(text.replace('"close.safetensors"', '"../close.safetensors"'))
    with pytest.raises(CheckpointError, match="file"):
        bundled_models()
