"""The tool that puts a trained model into the package."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import torch

from bushseg.bundled import bundled_models, bundled_path
from bushseg.checkpoint import load_checkpoint
from bushseg.model_choice import candidates
from bushseg.prediction import predict


@pytest.fixture(scope="module")
def tool():
    path = Path(__file__).parents[1] / "tools" / "bundle_model.py"
    spec = importlib.util.spec_from_file_location("bundle_model", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    (tmp_path / "index.toml").write_text("models = []\n")
    monkeypatch.setattr("bushseg.bundled.FOLDER", tmp_path)
    return tmp_path


def test_a_run_becomes_a_bundled_model(tool, folder, run, model, new_scene):
    for purpose in ("first", "second"):  # the same name replaces
        tool.bundle(run, "close", purpose, "MIT")
    (entry,) = bundled_models()
    assert (entry.name, entry.purpose, entry.voxel_size) == ("close", "second", 0.15)
    card, _, tensors = load_checkpoint(bundled_path(entry))
    assert card == model.card
    assert tensors["network.stem.linear.weight"].dtype == torch.float16
    assert tensors["network.stem.norm.running_var"].dtype == torch.float32
    half = candidates("close")[0].load()
    assert {p.dtype for p in half.network.parameters()} == {torch.float32}
    xyz = new_scene(9).xyz
    labels, probabilities = predict(xyz, "close")
    expected, exact = predict(xyz, model)
    assert (labels != expected).mean() < 0.01
    np.testing.assert_allclose(probabilities, exact, atol=0.02)


def test_what_is_too_heavy_is_not_shipped(tool, folder, run, monkeypatch):
    monkeypatch.setattr("bushseg.bundled.MAX_BYTES", 1000)
    with pytest.raises(SystemExit, match="at most 1,000"):
        tool.bundle(run, "close", "too heavy", "MIT")
    assert bundled_models() == ()
