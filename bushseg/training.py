"""Training: prepared crops in; checkpoints, metrics and curves out, into a run's folder."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from bushseg.batches import EpochBatches
from bushseg.checkpoint import build_network, load_checkpoint, network_weights, save_model
from bushseg.config import FINE_TUNING_RATE, Config, TrainConfig, first_difference
from bushseg.dataset import Dataset
from bushseg.errors import CheckpointError, ConfigError, DataError
from bushseg.files import atomic_path
from bushseg.history import summarize, write_history
from bushseg.loss import loss_weights, weighted_cross_entropy
from bushseg.models.batch import Batch
from bushseg.models.precision import multiplying_in
from bushseg.plots import plot_curves
from bushseg.pretrained import Pretrained, adopt, find_pretrained, with_network_of
from bushseg.progress import SILENT, Progress
from bushseg.runs import BEST, CURVES, LAST, METRICS, SETTINGS, new_run, remove_run
from bushseg.stages import Stages
from bushseg.training_card import describe_data
from bushseg.training_state import (
    TrainingState,
    optimizer_tensors,
    restore_optimizer,
    torch_seed,
)
from bushseg.validation import validate

_CURVES_SECONDS = 20.0
"""Drawing takes about a second: curves are drawn no more often than this, and at the end."""


@dataclass(frozen=True, slots=True)
class TrainResult:
    """What a training run made.

    Attributes:
        folder: The run's folder.
        epochs: Epochs finished, those of earlier parts of a resumed run included.
        history: One row of metrics for each of them.
        interrupted: Whether it was asked to stop before the last epoch.
        num_points: Voxels that went forward and backward in this call.
        seconds: How long this call trained, validation left out.
        stages: Seconds by stage, validation among them.
    """

    folder: Path
    epochs: int
    history: list[dict[str, float]]
    interrupted: bool
    num_points: int
    seconds: float
    stages: dict[str, float]


def train(
    data: str | Path = "prepared",
    run: str | Path | None = None,
    config: Config | None = None,
    *,
    pretrained: str | Path | None = None,
    resume: bool = False,
    overwrite: bool = False,
    stop: Callable[[], bool] = lambda: False,
    progress: Progress = SILENT,
) -> TrainResult:
    """Train a network on a prepared data set.

    Args:
        data: The data set's folder.
        run: The run's folder; None makes one in `runs/`, named by the time.
        config: Settings; None takes the defaults, or the run's own to resume it. The `prepare`
            section is always the data set's.
        pretrained: A model to begin with: a bundled model's name, "default" for the one of the data
            set's voxel size, a model file or a run. Classes and features may differ.
        resume: Go on with the run in `run`; the result is that of an uninterrupted run. All
            settings but the number of epochs must be the run's own.
        overwrite: Replace the run that stands in `run`.
        stop: Asked before each step; True saves and ends the run, which can then be resumed.
        progress: Told of the points trained on, and of each epoch's metrics.

    Returns:
        What was made.

    Raises:
        WriteError: The folder holds a run that is neither to be resumed nor overwritten.
        BushsegError: The data set or the checkpoint is missing, damaged or doesn't fit.
    """
    if resume and (overwrite or run is None or pretrained is not None):
        raise ConfigError(
            "resume needs the folder of the run, and can neither overwrite it nor begin anew"
        )
    folder = Path(run) if resume and run is not None else new_run(run, overwrite=overwrite)
    if config is None:
        config = Config.load(folder / SETTINGS) if resume else Config()
    if pretrained is not None:
        given = config.train.model_dump(exclude_unset=True) | {"pretrained": str(pretrained)}
        config = config.model_copy(update={"train": TrainConfig.from_dict(given)})
    trainer = Trainer(Dataset(data), folder, config, progress, resume=resume)
    if resume:
        trainer.restore()
    elif overwrite:
        remove_run(folder)
    return trainer.run(stop)


class Trainer:
    """One run: the network, its optimizer and how far they have come."""

    def __init__(
        self,
        dataset: Dataset,
        folder: Path,
        config: Config,
        progress: Progress = SILENT,
        *,
        resume: bool = False,
    ) -> None:
        self.dataset = dataset
        # A resumed run has its weights already, even if the model it began with is gone.
        begin = None if resume else config.train.pretrained
        source = None if begin is None else find_pretrained(begin, dataset.config)
        if source is not None:
            config = with_network_of(config, source.model.card)
        self.folder = folder
        self.config = config.model_copy(update={"prepare": dataset.config})
        self.progress = progress
        self.state = TrainingState(settings=config.train)
        self.stages = Stages()
        self._drawn_at, self._undrawn = 0.0, False
        self.train_tiles, self.held_out = dataset.split(config.train)
        self.card = describe_data(dataset, self.train_tiles, self.config)
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        with torch.random.fork_rng():
            torch.manual_seed(torch_seed(config.train.seed))
            self.network = build_network(self.card)
        if source is not None:
            self._begin_with(source)
        self.network.to(self.device)
        counts = dataset.class_counts(self.train_tiles)
        self.weights = loss_weights(counts, config.train.class_weights).to(self.device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), config.train.learning_rate)
        wanted = set(self.train_tiles)
        drawn = zip(dataset.crop_tiles, dataset.crop_labelled, strict=True)
        if not config.train.fresh_crops and not any(t in wanted and has for t, has in drawn):
            raise DataError(
                f"{dataset.folder}: none of its {len(dataset.crop_tiles)} crops has a label to "
                "train on; prepare with more --crops, or pass --fresh-crops"
            )

    def _begin_with(self, source: Pretrained) -> None:
        """Take over another model's weights."""
        anew = adopt(self.network, self.card, source.model)
        self.card = self.card.model_copy(
            update={"pretrained": source.name, "temperature": source.model.card.temperature}
        )
        rate = self.config.train.learning_rate
        gently = ", low, so that what it knows is kept" if rate <= FINE_TUNING_RATE else ""
        self.progress.note(
            "; ".join([f"begins with {source.name}", *anew, f"learning rate {rate:g}{gently}"])
        )

    def restore(self) -> None:
        """Load the last checkpoint of this run.

        Raises:
            CheckpointError: There is none, or it was trained with other settings or data.
        """
        path, settings = self.folder / LAST, self.config.train
        card, values, tensors = load_checkpoint(path)
        try:
            state = TrainingState.from_dict(values, "training state")
            state.confusion(card.scheme.num_classes)
        except (CheckpointError, ConfigError) as error:
            raise CheckpointError(f"{path}: can't be resumed ({error}); start a new run") from error
        # More epochs don't change those that are done; any other setting would.
        before = state.settings.model_copy(update={"epochs": settings.epochs})
        # What is found out in training, and which weights it began with, are the run's own.
        kept = {"temperature": card.temperature, "pretrained": card.pretrained}
        self.card = self.card.model_copy(update=kept)
        card = card.model_copy(update={"metrics": {}, "confidence": None})
        if changed := first_difference(card, self.card) or first_difference(before, settings):
            raise CheckpointError(
                f"{path}: {changed}; resume with the data and the settings it was trained with "
                f"({self.folder / SETTINGS}), or start a new run"
            )
        try:
            self.network.load_state_dict(network_weights(tensors))
            if state.has_begun:
                restore_optimizer(self.network, self.optimizer, tensors)
        except (CheckpointError, RuntimeError) as error:
            reason = str(error).splitlines()[-1].strip()
            raise CheckpointError(f"{path}: is damaged ({reason}); start a new run") from error
        self.state = state.model_copy(update={"settings": settings})

    def run(self, stop: Callable[[], bool]) -> TrainResult:
        """Train the epochs that are left."""
        settings = self.config.train
        with atomic_path(self.folder / SETTINGS) as partial:
            partial.write_text(self.config.to_toml(), encoding="utf-8")
        num_points, seconds, stopped = 0, 0.0, False
        first, started = self.state.epoch, time.monotonic()
        self._drawn_at = time.monotonic()
        while self.state.epoch < settings.epochs and not stopped:
            begun = time.perf_counter()
            points, stopped = self._epoch(stop)
            num_points, seconds = num_points + points, seconds + time.perf_counter() - begun
            if stopped:
                self._save_last()
            else:
                with self.stages.timed("metrics and checkpoints"):
                    self._finish_epoch(points / max(time.perf_counter() - begun, 1e-9))
                done, left = self.state.epoch - first, settings.epochs - self.state.epoch
                seconds_left = (time.monotonic() - started) * left / done
                row = self.state.history[-1]
                self.progress.note(summarize(row, settings.epochs, seconds_left))
        if self._undrawn:
            self._draw_curves()
        return TrainResult(
            folder=self.folder,
            epochs=self.state.epoch,
            history=self.state.history,
            interrupted=stopped,
            num_points=num_points,
            seconds=seconds,
            stages=self.stages.seconds,
        )

    def _epoch(self, stop: Callable[[], bool]) -> tuple[int, bool]:
        """Train the steps of this epoch that are left; says how many points, and if stopped."""
        settings, state = self.config.train, self.state
        for group in self.optimizer.param_groups:
            group["lr"] = settings.learning_rate * settings.decay**state.epoch
        self.network.train()
        confusion = state.confusion(self.dataset.scheme.num_classes)
        batches = EpochBatches(
            self.dataset, self.train_tiles, self.card.features, settings, state.epoch
        )
        self.progress.start(
            f"epoch {state.epoch + 1}/{settings.epochs}",
            batches.num_crops * self.dataset.config.crop_points,
            "points",
        )
        num_points = 0
        for batch, labels in self.stages.each("wait for batches", batches.start(state.step)):
            if stop():
                return num_points, True
            loss, logits = self._step(batch, labels)
            confusion.update(logits.argmax(dim=1).cpu().numpy(), labels.cpu().numpy())
            state.step += 1
            state.loss_sum += loss
            state.counts = confusion.counts.tolist()
            num_points += len(labels)
            self.progress.advance(len(labels))
        return num_points, False

    def _step(self, batch: Batch, labels: Tensor) -> tuple[float, Tensor]:
        """One forward, backward and update."""
        settings, state = self.config.train, self.state
        labels = labels.to(self.device)
        with multiplying_in(settings.precision):
            with self.stages.timed("forward"), torch.random.fork_rng():
                torch.manual_seed(torch_seed(settings.seed, state.epoch, state.step))
                logits = self.network(batch.to(self.device))
                loss = weighted_cross_entropy(logits, labels, self.weights)
            with self.stages.timed("backward"):
                self.optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
            with self.stages.timed("update"):
                self.optimizer.step()
        return float(loss.detach()), logits.detach()

    def _finish_epoch(self, points_per_second: float) -> None:
        """Validate, note the epoch's metrics, save."""
        state, names = self.state, self.dataset.scheme.names
        trained = state.confusion(len(names))
        row = {
            "epoch": state.epoch + 1,
            "learning_rate": float(self.optimizer.param_groups[0]["lr"]),
            "loss": state.loss_sum / max(state.step, 1),
            "train_oa": trained.oa,
            "train_miou": trained.miou,
            "points_per_second": points_per_second,
        }
        judged = trained
        if self.held_out:
            with self.stages.timed("validate"):
                found = validate(
                    self.network, self.dataset, self.held_out, self.card, self.progress
                )
            judged = found.confusion
            row |= {"val_oa": judged.oa, "val_miou": judged.miou}
            row |= {"val_ece": found.calibrated_ece, "val_ece_uncalibrated": found.ece}
            calibrated = {"temperature": found.temperature, "confidence": found.confidence}
            self.card = self.card.model_copy(update=calibrated)
            row |= {f"val_iou/{n}": float(v) for n, v in zip(names, judged.iou, strict=True)}
        state.history.append({key: float(value) for key, value in row.items()})
        state.epoch, state.step, state.loss_sum, state.counts = state.epoch + 1, 0, 0.0, []
        metrics = {k: None if math.isnan(v) else v for k, v in state.history[-1].items()}
        self.card = self.card.model_copy(update={"metrics": metrics})
        score = 0.0 if math.isnan(judged.miou) else judged.miou
        if score > state.best:
            state.best = score
            save_model(self.folder / BEST, self.card, self.network)
        self._save_last()
        write_history(self.folder / METRICS, state.history)
        self._undrawn = True
        if time.monotonic() - self._drawn_at >= _CURVES_SECONDS:
            self._draw_curves()

    def _draw_curves(self) -> None:
        plot_curves(self.state.history, self.folder / CURVES)
        self._drawn_at, self._undrawn = time.monotonic(), False

    def _save_last(self) -> None:
        save_model(
            self.folder / LAST,
            self.card,
            self.network,
            extra=optimizer_tensors(self.network, self.optimizer),
            state=self.state.model_dump(),
        )
