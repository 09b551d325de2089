"""A model in the box, by commands alone: chosen, named, listed and trained on from."""

import json
from pathlib import Path

import laspy
import pytest

pytestmark = pytest.mark.usefixtures("bundle")


def test_predict_needs_no_training(bushseg, scans):
    outcome = bushseg("predict", scans / "south.las", "-o", "labeled.las")
    assert outcome.status == 0
    assert 'model: bundled "close", voxels of 0.15 m, since at that size' in outcome.out
    assert len(laspy.read("labeled.las")) == 4000


def test_predict_by_name(bushseg, scans):
    named = ("predict", scans / "south.las", "-o", "out.las", "--model", "airborne", "--json")
    result = json.loads(bushseg(*named).out)
    assert (result["model"], result["reason"]) == ('bundled "airborne"', "")
    assert result["warnings"][0].startswith('bundled "close" suits the scan better')
    unknown = bushseg("predict", scans / "south.las", "-o", "new.las", "-m", "near")
    assert unknown.status == 1
    assert "bundled are close, airborne" in unknown.err


def test_models_lists_them(bushseg):
    outcome = bushseg("models")
    assert outcome.status == 0
    assert "tests of close range" in outcome.out
    assert "mIoU" in outcome.out
    listed = json.loads(bushseg("models", "--json").out)
    assert [entry["name"] for entry in listed] == ["close", "airborne"]
    assert all(entry["num_bytes"] > 1000 for entry in listed)
    described = bushseg("models", "-m", "close")
    assert "confidence" in described.out
    assert "at temperature" in described.out


def test_no_models_at_all(bushseg, tmp_path, monkeypatch, scans):
    (tmp_path / "index.toml").write_text("models = []\n")
    monkeypatch.setattr("bushseg.bundled.FOLDER", tmp_path)
    assert "no models" in bushseg("models").out
    outcome = bushseg("predict", scans / "south.las", "-o", "out.las")
    assert outcome.status == 1
    assert "bushseg train" in outcome.err


def test_fine_tuning(bushseg, scans):
    """From a scan of one's own to a model that began with the bundled one."""
    # The tiny model's settings come with the model, not from a file.
    made = bushseg("prepare", scans, "--for", "default", "--crops", 8)
    assert made.status == 0
    assert 'prepared for bundled "close"' in made.err
    trained = bushseg("train", "-o", "tuned", "--from", "default", "--epochs", 1)
    assert trained.status == 0
    assert "learning rate 0.001, low, so that what it knows is kept" in trained.err
    described = json.loads(bushseg("models", "-m", "tuned", "--json").out)
    assert described["card"]["pretrained"].startswith('bundled "close"')
    assert "learning_rate = 0.001" in Path("tuned/config.toml").read_text()
    resumed = bushseg("train", "--resume", "tuned")
    assert resumed.status == 0
    refused = bushseg("train", "--resume", "tuned", "--from", "close")
    assert refused.status == 2


def test_data_prepared_otherwise(bushseg, prepared):
    refused = bushseg("train", prepared, "--from", "airborne")
    assert refused.status == 1
    assert "bushseg prepare SCANS --for airborne" in refused.err
