"""Training that begins with another model: what is taken over, what is refused, what is said."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bushseg.checkpoint import Model, build_network, load_checkpoint, load_model
from bushseg.config import Config, NetworkConfig, PrepareConfig, TrainConfig
from bushseg.errors import CheckpointError, ConfigError
from bushseg.labels import load_scheme
from bushseg.preparation import prepare
from bushseg.pretrained import adopt, find_pretrained, settings_for, with_network_of
from bushseg.progress import Silent
from bushseg.training import train


class Notes(Silent):
    def __init__(self) -> None:
        self.lines: list[str] = []

    def note(self, message: str) -> None:
        self.lines.append(message)


@pytest.fixture(autouse=True)
def _no_curves(run, monkeypatch):
    monkeypatch.setattr("bushseg.run_files.plot_curves", lambda _history, path: path.touch())


def tuned(config: Config, **settings) -> Config:
    """The same without a learning rate of its own, so that the default shows."""
    given = config.train.model_dump(exclude_unset=True) | settings
    return config.model_copy(update={"train": TrainConfig(**given)})


def with_card(model: Model, **changes) -> Model:
    return replace(model, card=model.card.model_copy(update=changes))


def fresh(model: Model, **changes) -> Model:
    """A new network for a changed card."""
    made = with_card(model, **changes)
    return replace(made, network=build_network(made.card))


def test_the_same_card_takes_over_everything(model):
    new = fresh(model)
    assert adopt(new.network, new.card, model) == []
    for name, tensor in model.network.state_dict().items():
        assert torch.equal(new.network.state_dict()[name], tensor)


def test_columns_follow_their_feature(model):
    """The model knows rgb, intensity, height: of height alone, its fifth column stays."""
    new = fresh(model, features=("height",))
    adopt(new.network, new.card, model)
    assert torch.equal(new.network.stem.linear.weight, model.network.stem.linear.weight[:, 4:])


def test_new_features_begin_at_zero(model):
    poor = fresh(model, features=("height",))
    adopt(poor.network, poor.card, model)
    rich = fresh(model)
    assert adopt(rich.network, rich.card, poor) == ["new features: rgb, intensity"]
    weight = rich.network.stem.linear.weight
    assert not weight[:, :4].any()
    assert torch.equal(weight[:, 4:], poor.network.stem.linear.weight)


def test_rows_follow_their_class(model):
    scheme = load_scheme("asprs")
    new = fresh(model, scheme=scheme)
    before = new.network.head[3].weight.clone()
    (note,) = adopt(new.network, new.card, model)
    after, known = new.network.head[3], model.card.scheme.names
    assert "new classes: " in note
    assert "ground" not in note
    assert "ground" in scheme.names
    for index, name in enumerate(scheme.names):
        if name in known:
            assert torch.equal(after.weight[index], model.network.head[3].weight[known.index(name)])
            assert after.bias[index] == model.network.head[3].bias[known.index(name)]
        else:
            assert torch.equal(after.weight[index], before[index])


def test_weights_that_do_not_fit(model):
    wider = NetworkConfig(**model.card.network.model_dump() | {"widths": (16, 16)})
    new = fresh(model, network=wider)
    with pytest.raises(CheckpointError, match="weights don't fit") as caught:
        adopt(new.network, new.card, model)
    assert "\n" not in str(caught.value)


def test_default_is_the_bundled_model_of_the_voxel_size(bundle, model):
    found = find_pretrained("default", model.card.prepare)
    assert found.name.startswith('bundled "close" (SHA-256 ')


def test_data_prepared_otherwise_are_told_how(bundle, model):
    other = model.card.prepare.model_copy(update={"voxel_size": 0.2})
    with pytest.raises(ConfigError, match=r"voxel_size 0\.2.*wants 0\.15.*--for close"):
        find_pretrained("close", other)
    other = model.card.prepare.model_copy(update={"num_neighbors": 16})
    with pytest.raises(ConfigError, match="num_neighbors 16"):
        find_pretrained("close", other)


def test_settings_for_a_model(bundle, scans, model):
    theirs = model.card.prepare
    made, whose = settings_for("close", [scans], PrepareConfig(scheme="asprs", seed=4))
    assert (made.scheme, made.seed) == ("asprs", 4)
    assert (made.voxel_size, made.num_levels) == (0.15, theirs.num_levels)
    assert whose == 'bundled "close"'
    made, whose = settings_for("default", [scans], PrepareConfig())
    assert made.voxel_size == 0.15
    assert "neighbors lie within" in whose
    with pytest.raises(ConfigError, match=r"voxel_size is 0\.2.*wants 0\.15"):
        settings_for("close", [scans], PrepareConfig(voxel_size=0.2))


def test_the_model_brings_its_network(model):
    assert with_network_of(Config(), model.card).network == model.card.network
    with pytest.raises(ConfigError, match="another network"):
        with_network_of(Config(network=NetworkConfig(attention="se")), model.card)


def test_training_goes_on_from_what_is_known(bundle, run, prepared, tiny, tmp_path):
    """One step at a low rate leaves a model about as good as the one it began with."""
    config = tuned(tiny(epochs=1, steps_per_epoch=1, validation="scan:south"), pretrained="close")
    notes = Notes()
    result = train(prepared, tmp_path / "run", config, progress=notes)
    before = load_model(run / "best.safetensors").card
    assert result.history[0]["val_miou"] > before.metrics["val_miou"] - 0.1
    assert result.history[0]["learning_rate"] == 0.001
    card = load_model(tmp_path / "run" / "best.safetensors").card
    assert card.pretrained.startswith('bundled "close" (SHA-256 ')
    assert notes.lines[0].startswith('begins with bundled "close"')
    assert "learning rate 0.001, low" in notes.lines[0]


def test_a_rate_that_is_given_is_taken():
    assert TrainConfig(pretrained="default").learning_rate == 0.001
    assert TrainConfig(pretrained="default", learning_rate=0.02).learning_rate == 0.02
    assert TrainConfig().learning_rate == 0.01


def test_it_resumes_without_the_model_it_began_with(run, prepared, tiny, tmp_path):
    source = tmp_path / "source.safetensors"
    source.write_bytes((run / "best.safetensors").read_bytes())
    config = tiny(epochs=2, steps_per_epoch=2, validation="scan:south")
    whole = train(prepared, tmp_path / "whole", tuned(config), pretrained=source)
    half = tuned(config, epochs=1)
    train(prepared, tmp_path / "run", half, pretrained=source)
    source.unlink()
    longer = Config.load(tmp_path / "run" / "config.toml", {"train": {"epochs": 2}})
    resumed = train(prepared, tmp_path / "run", longer, resume=True)
    assert resumed.epochs == 2
    first, second = (load_checkpoint(r.folder / "last.safetensors") for r in (whole, resumed))
    assert all(torch.equal(first[2][name], second[2][name]) for name in first[2])
    assert second[0].pretrained == first[0].pretrained


def test_few_labels_among_many_points(new_scene, write_las, tiny, run, tmp_path):
    """Labels in one corner only: crops without any are passed over, cached or fresh."""
    scene = new_scene(0, 12_000)
    corner = (scene.xyz[:, :2] < 1.5).all(axis=1)
    scene = replace(scene, codes=np.where(corner, scene.codes, 0).astype(np.uint8))
    path = write_las(tmp_path / "painted.las", scene)
    settings = tiny().prepare.model_copy(update={"crop_points": 256, "num_crops": 40})
    prepare([path], tmp_path / "data", settings)
    for fresh_crops in (False, True):
        config = tuned(tiny(epochs=1, fresh_crops=fresh_crops, steps_per_epoch=None))
        folder = tmp_path / f"run-{fresh_crops}"
        result = train(tmp_path / "data", folder, config, pretrained=run)
        assert np.isfinite(result.history[0]["loss"])
        assert result.history[0]["loss"] > 0
        card = load_model(Path(folder) / "best.safetensors").card
        # Nothing to calibrate on: what the model brought stays.
        assert card.temperature == load_model(run / "best.safetensors").card.temperature
