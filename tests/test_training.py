import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from bushseg.checkpoint import load_checkpoint, load_model
from bushseg.config import Config, NetworkConfig
from bushseg.errors import BushsegError, CheckpointError, ConfigError, DataError
from bushseg.preparation import prepare
from bushseg.training import train

FILES = ["best.safetensors", "config.toml", "curves.png", "last.safetensors", "metrics.csv"]


@pytest.fixture(scope="module", autouse=True)
def _no_curves(run):
    """Drawing takes longer than everything else here; `run` has been drawn before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bushseg.run_files.plot_curves", lambda _history, path: path.touch())
        yield


def losses(result) -> list[float]:
    return [row["loss"] for row in result.history]


def without_speed(history: list[dict[str, float]]) -> list[dict[str, float]]:
    return [{k: v for k, v in row.items() if k != "points_per_second"} for row in history]


def table(run: Path) -> list[dict[str, float]]:
    with (run / "metrics.csv").open(newline="") as file:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]


def same_tensors(one: Path, two: Path) -> bool:
    first, second = (load_checkpoint(run / "last.safetensors")[2] for run in (one, two))
    return first.keys() == second.keys() and all(
        torch.equal(first[name], second[name]) for name in first
    )


class StopAfter:
    """Asks for an end before step `steps` (from 0)."""

    def __init__(self, steps: int) -> None:
        self.left = steps

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


def test_it_learns(run):
    rows = table(run)
    assert [row["epoch"] for row in rows] == [1, 2, 3, 4, 5, 6]
    assert rows[-1]["loss"] < 0.7 * rows[0]["loss"]
    assert max(row["val_miou"] for row in rows) > 0.5
    rates = [row["learning_rate"] for row in rows]
    np.testing.assert_allclose(rates, 0.01 * 0.95 ** np.arange(6))


def test_what_a_run_leaves(run):
    assert sorted(path.name for path in run.iterdir()) == FILES
    assert (run / "curves.png").read_bytes().startswith(b"\x89PNG")
    config = Config.load(run / "config.toml")
    assert config.prepare.voxel_size == 0.15  # the data set's own
    assert config.train.validation == "scan:south"


def test_the_best_model_is_the_best_of_the_table(run):
    card = load_model(run / "best.safetensors").card
    scores = [row["val_miou"] for row in table(run)]
    assert card.metrics["val_miou"] == max(scores)
    assert card.features == ("rgb", "intensity", "height")
    assert card.optional_features == ("rgb", "intensity")
    low, high = card.neighbor_distance
    assert 0.1 < low <= high < 0.6


@pytest.fixture(scope="module", params=["cached", "fresh"])
def whole(request, prepared, tiny, tmp_path_factory):
    """Four epochs without a stop, and their settings."""
    config = tiny(epochs=4, steps_per_epoch=3, fresh_crops=request.param == "fresh")
    folder = tmp_path_factory.mktemp("whole") / "run"
    return config, train(prepared, folder, config)


def test_same_seed_same_run(whole, prepared, tmp_path):
    config, result = whole
    again = train(prepared, tmp_path / "again", config)
    assert without_speed(again.history) == without_speed(result.history)
    assert same_tensors(result.folder, again.folder)


def test_two_epochs_and_two_more_are_four(whole, prepared, tmp_path):
    config, result = whole
    half = config.model_copy(update={"train": config.train.model_copy(update={"epochs": 2})})
    first = train(prepared, tmp_path / "run", half)
    assert (first.epochs, first.interrupted) == (2, False)
    second = train(prepared, tmp_path / "run", config, resume=True)
    assert second.epochs == 4
    assert without_speed(second.history) == without_speed(result.history)
    assert same_tensors(result.folder, second.folder)
    assert len(table(tmp_path / "run")) == 4


@pytest.mark.parametrize("steps", [0, 4])
def test_stopped_in_mid_epoch_and_resumed(whole, prepared, tmp_path, steps):
    config, result = whole
    first = train(prepared, tmp_path / "run", config, stop=StopAfter(steps))
    assert first.interrupted
    assert first.epochs == steps // 3
    second = train(prepared, tmp_path / "run", config, resume=True)
    assert not second.interrupted
    assert without_speed(second.history) == without_speed(result.history)
    assert same_tensors(result.folder, second.folder)
    assert first.num_points + second.num_points == result.num_points


def test_another_seed_is_another_run(whole, prepared, tiny, tmp_path):
    config, result = whole
    other = config.model_copy(update={"train": config.train.model_copy(update={"seed": 1})})
    one_epoch = other.model_copy(update={"train": other.train.model_copy(update={"epochs": 1})})
    assert losses(train(prepared, tmp_path / "run", one_epoch))[0] != losses(result)[0]


def test_resuming_a_finished_run_does_nothing(run, prepared, tmp_path):
    folder = shutil.copytree(run, tmp_path / "run")
    before = (folder / "last.safetensors").read_bytes()
    config = Config.load(folder / "config.toml")
    result = train(prepared, folder, config, resume=True)
    assert (result.epochs, result.num_points, result.interrupted) == (6, 0, False)
    assert (folder / "last.safetensors").read_bytes() == before


def test_the_loss_of_an_epoch_is_the_mean_of_its_steps(prepared, tiny, tmp_path):
    """A network that doesn't learn guesses among seven classes: about ln 7 at every step."""
    config = tiny(epochs=1, steps_per_epoch=4, learning_rate=1e-9, class_weights="none")
    assert 1.4 < losses(train(prepared, tmp_path / "run", config))[0] < 2.8


def test_random_state_of_the_caller_is_left_alone(prepared, tiny, tmp_path):
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    train(prepared, tmp_path / "run", tiny(epochs=1, steps_per_epoch=1))
    assert torch.equal(torch.rand(3), expected)


def test_without_feature_dropout_nothing_is_optional(prepared, tiny, tmp_path):
    config = tiny(epochs=1, steps_per_epoch=1, augment={"feature_dropout": 0})
    card = load_model(train(prepared, tmp_path / "run", config).folder / "best.safetensors").card
    assert card.optional_features == ()


def test_resume_needs_a_run(prepared, tiny, tmp_path):
    with pytest.raises(CheckpointError, match="no such file"):
        train(prepared, tmp_path / "nowhere", tiny(), resume=True)


def test_layers_must_match_the_data(prepared, tiny, tmp_path):
    config = tiny().model_copy(update={"network": NetworkConfig(widths=(8, 16, 16))})
    with pytest.raises(ConfigError, match="3 layers, the data 2 levels"):
        train(prepared, tmp_path / "run", config)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("validation", ["scan:east", "some"])
def test_a_validation_that_is_none(prepared, tiny, tmp_path, validation):
    with pytest.raises(ConfigError, match="validation"):
        train(prepared, tmp_path / "run", tiny(validation=validation))


def test_no_labels(new_scene, tiny, tmp_path):
    path = tmp_path / "bare.txt"
    np.savetxt(path, new_scene(0, 1000).xyz, fmt="%.3f")
    prepare([path], tmp_path / "data", tiny().prepare)
    with pytest.raises(DataError, match="no labelled tile"):
        train(tmp_path / "data", tmp_path / "run", tiny())


def test_no_crop_in_any_training_tile(scans, tiny, tmp_path):
    config = tiny().prepare.model_copy(update={"num_crops": 1})
    prepare([scans], tmp_path / "data", config)
    outcomes = []
    for name in ("north", "middle", "south"):
        settings = tiny(epochs=1, validation=f"scan:{name}", steps_per_epoch=1)
        try:
            train(tmp_path / "data", tmp_path / name, settings)
            outcomes.append("trained")
        except DataError as error:
            outcomes.append("refused" if "crops" in str(error) else str(error))
    assert sorted(outcomes) == ["refused", "trained", "trained"]


def test_a_scan_of_a_few_points_trains(new_scene, write_las, tiny, tmp_path):
    """Its crops have one survivor at the coarsest level, its last batch a single crop."""
    path = write_las(tmp_path / "small.las", new_scene(0, 24))
    prepare([path], tmp_path / "data", tiny().prepare)
    config = tiny(epochs=1, batch_size=1, steps_per_epoch=2)
    assert np.isfinite(losses(train(tmp_path / "data", tmp_path / "run", config))).all()


def test_a_missing_data_set(tiny, tmp_path):
    with pytest.raises(BushsegError, match="bushseg prepare"):
        train(tmp_path / "nowhere", tmp_path / "run", tiny())


def test_the_card_says_how_sure_the_model_may_be(run):
    card = load_model(run / "best.safetensors").card
    assert card.temperature != 1
    assert card.metrics["val_ece"] <= card.metrics["val_ece_uncalibrated"] + 0.02
    # Calibrated, mean confidence is about the share that is right.
    assert card.confidence == pytest.approx(card.metrics["val_oa"], abs=0.1)
    low, high = card.heights
    assert -1 < low < 0.2
    assert 1.2 < high < 2.5  # bushes of 1.4 m, a wall of 2 m
    assert 0.2 < card.low_share < 0.9
    assert card.pretrained is None


def test_nothing_held_out_is_nothing_to_calibrate_on(prepared, tiny, tmp_path):
    result = train(prepared, tmp_path / "run", tiny(epochs=1, steps_per_epoch=1))
    card = load_model(result.folder / "best.safetensors").card
    assert (card.temperature, card.confidence) == (1.0, None)
