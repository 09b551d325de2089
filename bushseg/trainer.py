"""A training run, epoch by epoch."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from bushseg.batches import EpochBatches
from bushseg.config import FINE_TUNING_RATE, Config
from bushseg.dataset import Dataset
from bushseg.errors import DataError
from bushseg.history import summarize
from bushseg.learner import Learner
from bushseg.loss import loss_weights
from bushseg.metrics import ConfusionMatrix
from bushseg.pretrained import Pretrained, adopt, find_pretrained, with_network_of
from bushseg.progress import SILENT, Progress
from bushseg.ranks import current
from bushseg.run_files import RunFiles, restore
from bushseg.stages import Stages
from bushseg.training_card import describe_data
from bushseg.training_state import TrainingState
from bushseg.validation import validate


@dataclass(frozen=True, slots=True)
class TrainResult:
    """What a training run made.

    Attributes:
        folder: The run's folder.
        rank: Which of several processes this is; the first, 0, wrote it all.
        epochs: Epochs finished, those of earlier parts of a resumed run included.
        history: One row of metrics for each of them.
        interrupted: Whether it was asked to stop before the last epoch.
        num_points: Voxels that went forward and backward in this call.
        seconds: How long this call trained, validation left out.
        stages: Seconds by stage, validation among them.
    """

    folder: Path
    rank: int
    epochs: int
    history: list[dict[str, float]]
    interrupted: bool
    num_points: int
    seconds: float
    stages: dict[str, float]


class Trainer:
    """One run: what is learnt from, and how far it has come.

    Args:
        dataset: The data set.
        folder: The run's folder.
        config: Settings.
        progress: Told of the points trained on, and of each epoch's metrics.
        resume: Go on from the last checkpoint in the folder.

    Raises:
        BushsegError: The data set or the checkpoint is damaged or doesn't fit.
    """

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
        self.files = RunFiles(folder, config.train.checkpoint_minutes)
        self.stages = Stages()
        self.train_tiles, self.held_out = dataset.split(config.train)
        self._check_crops()
        self.card = describe_data(dataset, self.train_tiles, self.config)
        counts = dataset.class_counts(self.train_tiles)
        weights = loss_weights(counts, config.train.class_weights)
        self.learner = Learner(self.card, config.train, weights, self.stages)
        self.state = TrainingState(settings=config.train)
        if source is not None:
            self._begin_with(source)
        if resume:
            self.card, self.state = restore(folder, self.card, self.config, self.learner)
        self.ranks = current()
        if self.ranks.size > 1:
            state = self.state.model_dump_json(exclude={"history": True})
            self.ranks.check_same(state + self.card.model_dump_json(exclude={"metrics"}))
            self.learner.share_weights()

    def _check_crops(self) -> None:
        """Refuse a data set none of whose crops teaches anything."""
        wanted, data = set(self.train_tiles), self.dataset
        drawn = zip(data.crop_tiles, data.crop_labelled, strict=True)
        if not self.config.train.fresh_crops and not any(t in wanted and has for t, has in drawn):
            raise DataError(
                f"{data.folder}: none of its {len(data.crop_tiles)} crops has a label to "
                "train on; prepare with more --crops, or pass --fresh-crops"
            )

    def _begin_with(self, source: Pretrained) -> None:
        """Take over another model's weights."""
        anew = adopt(self.learner.network, self.card, source.model)
        self.card = self.card.model_copy(
            update={"pretrained": source.name, "temperature": source.model.card.temperature}
        )
        rate = self.config.train.learning_rate
        gently = ", low, so that what it knows is kept" if rate <= FINE_TUNING_RATE else ""
        self.progress.note(
            "; ".join([f"begins with {source.name}", *anew, f"learning rate {rate:g}{gently}"])
        )

    def run(self, stop: Callable[[], bool]) -> TrainResult:
        """Train the epochs that are left."""
        settings = self.config.train
        if self.ranks.is_first:
            self.files.save_settings(self.config)
            self.files.catch_up(self.state.history)
        num_points, seconds, stopped = 0, 0.0, False
        first, started = self.state.epoch, time.monotonic()
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
        self.files.finish()
        return TrainResult(
            folder=self.folder,
            rank=self.ranks.rank,
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
        self.learner.begin_epoch(state.epoch)
        batches = EpochBatches(
            self.dataset, self.train_tiles, self.card.features, settings, state.epoch
        )
        self.progress.start(
            f"epoch {state.epoch + 1}/{settings.epochs}",
            batches.num_crops * self.dataset.config.crop_points,
            "points",
        )
        confusion, num_points = state.confusion(self.dataset.scheme.num_classes), 0
        for batch, labels in self.stages.each("wait for batches", batches.start(state.step)):
            if self._is_stopped(stop):
                return num_points, True
            done = self.learner.step(batch, labels, state.epoch, state.step)
            confusion += done.confusion
            state.step += 1
            state.loss_sum += done.loss
            state.counts = confusion.counts.tolist()
            num_points += done.num_points
            self.progress.advance(done.num_points)
            if self.ranks.is_first and self.files.is_due and state.step < len(batches):
                with self.stages.timed("metrics and checkpoints"):
                    self._save_last()
        return num_points, False

    def _is_stopped(self, stop: Callable[[], bool]) -> bool:
        """Whether any process is asked to stop: then all do, before the same step."""
        return bool(self.ranks.total(torch.tensor(int(stop()))))

    def _finish_epoch(self, points_per_second: float) -> None:
        """Validate, note the epoch's metrics, save."""
        state, trained = self.state, self.state.confusion(self.dataset.scheme.num_classes)
        row = {
            "epoch": state.epoch + 1,
            "learning_rate": self.learner.learning_rate,
            "loss": state.loss_sum / max(state.step, 1),
            "train_oa": trained.oa,
            "train_miou": trained.miou,
            "points_per_second": points_per_second,
        }
        judged = self._validate(row) if self.held_out else trained
        state.history.append({key: float(value) for key, value in row.items()})
        state.epoch, state.step, state.loss_sum, state.counts = state.epoch + 1, 0, 0.0, []
        metrics = {k: None if math.isnan(v) else v for k, v in state.history[-1].items()}
        self.card = self.card.model_copy(update={"metrics": metrics})
        score = 0.0 if math.isnan(judged.miou) else judged.miou
        if score > state.best:
            state.best = score
            if self.ranks.is_first:
                self.files.save_best(self.card, self.learner)
        self._save_last()
        if self.ranks.is_first:
            self.files.save_history(state.history)

    def _validate(self, row: dict[str, float]) -> ConfusionMatrix:
        """Judge the network by what is held out; writes the metrics into the epoch's row."""
        with self.stages.timed("validate"):
            found = validate(
                self.learner.network, self.dataset, self.held_out, self.card, self.progress
            )
        judged, names = found.confusion, self.dataset.scheme.names
        row |= {"val_oa": judged.oa, "val_miou": judged.miou}
        row |= {"val_ece": found.calibrated_ece, "val_ece_uncalibrated": found.ece}
        row |= {f"val_iou/{n}": float(v) for n, v in zip(names, judged.iou, strict=True)}
        calibrated = {"temperature": found.temperature, "confidence": found.confidence}
        self.card = self.card.model_copy(update=calibrated)
        return judged

    def _save_last(self) -> None:
        """Write the last checkpoint, if this is the process that writes."""
        if self.ranks.is_first:
            self.files.save_last(self.card, self.learner, self.state)
