"""What may become of a run that stands: gone on with, replaced, or left alone."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from safetensors import safe_open
from safetensors.torch import save_file

from bushseg.checkpoint import load_checkpoint
from bushseg.config import Config, NetworkConfig
from bushseg.errors import CheckpointError, ConfigError, WriteError
from bushseg.runs import BEST, CURVES, LAST, METRICS
from bushseg.training import train


@pytest.fixture
def drawn(monkeypatch) -> list[int]:
    """How many epochs each drawing of the curves had; nothing is drawn."""
    lengths: list[int] = []
    monkeypatch.setattr(
        "bushseg.run_files.plot_curves", lambda history, _path: lengths.append(len(history))
    )
    return lengths


@pytest.fixture
def copy(run, tmp_path, drawn) -> Path:
    """The tiny run of six epochs, to be written to."""
    return shutil.copytree(run, tmp_path / "run")


@pytest.fixture
def longer(copy) -> Config:
    """The run's own settings, with two epochs more."""
    return with_train(Config.load(copy / "config.toml"), epochs=8)


def with_train(config: Config, **changes: Any) -> Config:
    values = config.model_dump()
    values["train"] |= changes
    return Config.from_dict(values)


@pytest.mark.parametrize("left", [BEST, LAST])
def test_a_run_is_not_overwritten_unasked(copy, prepared, tiny, left, contents):
    (copy / (LAST if left == BEST else BEST)).unlink()
    before = contents(copy)
    with pytest.raises(WriteError, match=r"run: holds a run already; .*--resume .*--overwrite"):
        train(prepared, copy, tiny(epochs=1, steps_per_epoch=1))
    assert contents(copy) == before


def test_overwriting_leaves_nothing_of_the_run_before(copy, prepared, tiny, contents):
    """Stopped before its first epoch ends, the new run has no best model: nor has its folder."""
    (copy / "notes.txt").write_text("mine")
    result = train(prepared, copy, tiny(), overwrite=True, stop=lambda: True)
    assert result.interrupted
    assert sorted(contents(copy)) == ["config.toml", LAST, "notes.txt"]


def test_overwriting_waits_until_all_else_is_checked(copy, prepared, tiny, contents):
    before = contents(copy)
    with pytest.raises(ConfigError, match="validation"):
        train(prepared, copy, tiny(validation="some"), overwrite=True)
    assert contents(copy) == before


@pytest.mark.parametrize("options", [{"run": None}, {"overwrite": True}])
def test_resume_needs_a_run_to_keep(copy, prepared, options):
    with pytest.raises(ConfigError, match="resume"):
        train(**({"data": prepared, "run": copy, "resume": True} | options))


def test_more_epochs_may_be_asked_for(copy, prepared, longer):
    assert train(prepared, copy, longer, resume=True).epochs == 8


def test_a_resumed_run_keeps_its_own_settings(copy, prepared):
    result = train(prepared, copy, resume=True)
    assert (result.epochs, result.num_points) == (6, 0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"learning_rate": 0.02}, "learning_rate was 0.01, is 0.02"),
        ({"seed": 1}, "seed was 0, is 1"),
        ({"batch_size": 3}, "batch_size was 2, is 3"),
        ({"augment": {"rotate": False}}, "augment.rotate was True, is False"),
        ({"class_weights": "none"}, "class_weights was 'sqrt', is 'none'"),
    ],
)
def test_resuming_with_another_setting_names_it(copy, prepared, longer, changes, words, contents):
    before = contents(copy)
    with pytest.raises(CheckpointError, match=words) as caught:
        train(prepared, copy, with_train(longer, **changes), resume=True)
    assert "\n" not in str(caught.value)
    assert contents(copy) == before


def test_resuming_with_another_network_names_the_switch(copy, prepared, longer):
    other = NetworkConfig(**(longer.network.model_dump() | {"attention": "se"}))
    with pytest.raises(CheckpointError, match=r"network\.attention was 'mam', is 'se'"):
        train(prepared, copy, longer.model_copy(update={"network": other}), resume=True)


def damage(path: Path, *, state: str | None = None, drop: str = "") -> None:
    """Write a checkpoint again with another state, or without the tensors that end in `drop`."""
    with safe_open(path, framework="pt") as file:
        metadata = file.metadata()
    tensors = load_checkpoint(path)[2]
    if drop:
        tensors = {name: t for name, t in tensors.items() if not name.endswith(drop)}
    save_file(tensors, path, metadata=metadata | ({} if state is None else {"state": state}))


@pytest.mark.parametrize("state", ["{}", "[]", "3", "null", '{"epoch": 1}'])
def test_a_state_that_is_none(copy, prepared, longer, state):
    damage(copy / LAST, state=state)
    with pytest.raises(CheckpointError, match=r"last\.safetensors: can't be resumed") as caught:
        train(prepared, copy, longer, resume=True)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("drop", [".exp_avg", ".step", "stem.linear.weight"])
def test_tensors_that_are_missing(copy, prepared, longer, drop):
    damage(copy / LAST, drop=drop)
    with pytest.raises(CheckpointError, match=r"last\.safetensors: is damaged") as caught:
        train(prepared, copy, longer, resume=True)
    assert "\n" not in str(caught.value)


def test_a_best_model_alone_cannot_be_resumed(copy, prepared, longer):
    shutil.copy(copy / BEST, copy / LAST)
    with pytest.raises(CheckpointError, match="settings is missing"):
        train(prepared, copy, longer, resume=True)


def test_curves_are_drawn_at_the_end(prepared, tiny, tmp_path, drawn):
    train(prepared, tmp_path / "run", tiny(epochs=3, steps_per_epoch=1))
    assert drawn == [3]


def test_curves_are_drawn_on_the_way_when_it_takes_long(
    prepared, tiny, tmp_path, drawn, monkeypatch
):
    monkeypatch.setattr("bushseg.run_files._CURVES_SECONDS", 0.0)
    train(prepared, tmp_path / "run", tiny(epochs=3, steps_per_epoch=1))
    assert drawn == [1, 2, 3]


def test_an_interrupted_run_has_its_curves(prepared, tiny, tmp_path, drawn):
    answers = iter([False, True])  # one step an epoch: stops in the second
    config = tiny(epochs=3, steps_per_epoch=1)
    result = train(prepared, tmp_path / "run", config, stop=lambda: next(answers))
    assert (result.interrupted, drawn) == (True, [1])
    assert (tmp_path / "run" / METRICS).exists()


@pytest.mark.parametrize("name", [METRICS, CURVES])
def test_what_a_killed_run_had_not_come_to_is_made_up_for(copy, prepared, drawn, name):
    table = (copy / METRICS).read_bytes()
    (copy / name).unlink()
    train(prepared, copy, resume=True)
    assert drawn == [6]
    assert (copy / METRICS).read_bytes() == table


def test_nothing_new_is_nothing_to_draw(copy, prepared, drawn):
    train(prepared, copy, resume=True)
    assert drawn == []
    assert (copy / CURVES).exists()
