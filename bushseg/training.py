"""Training: prepared crops in, checkpoints, metrics and curves out.

runs/NAME/
  best.safetensors      the best model on the held-out split; usable with nothing else
  last.safetensors      the latest, with all that --resume needs
  metrics.csv           one row an epoch
  curves.png            the same, drawn
  config.toml           every setting as it was resolved
"""

import csv
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from bushseg.augment import DROPPABLE, augment
from bushseg.checkpoint import ModelCard, build_network, load_checkpoint, save_model
from bushseg.config import Config
from bushseg.dataset import Dataset, Sample
from bushseg.errors import CheckpointError
from bushseg.files import atomic_path
from bushseg.inference import feature_matrix, tile_logits
from bushseg.metrics import ConfusionMatrix
from bushseg.models.batch import Batch
from bushseg.models.bushnet import BushNet
from bushseg.plots import plot_curves
from bushseg.progress import SILENT, Progress
from bushseg.training_state import (
    TrainingState,
    generator,
    optimizer_tensors,
    restore_optimizer,
    torch_seed,
)

BEST, LAST, METRICS, CURVES, SETTINGS = (
    "best.safetensors",
    "last.safetensors",
    "metrics.csv",
    "curves.png",
    "config.toml",
)


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
    """

    folder: Path
    epochs: int
    history: list[dict[str, float]]
    interrupted: bool
    num_points: int
    seconds: float


def train(
    data: str | Path = "prepared",
    run: str | Path | None = None,
    config: Config | None = None,
    *,
    resume: bool = False,
    stop: Callable[[], bool] = lambda: False,
    progress: Progress = SILENT,
) -> TrainResult:
    """Train a network on a prepared data set.

    Args:
        data: The data set's folder.
        run: The run's folder; None makes one in `runs/`, named by the time.
        config: Settings; None takes the defaults. Its `prepare` section is the data set's own.
        resume: Go on with the run in `run`; the result is that of an uninterrupted run.
        stop: Asked before each step; True saves and ends the run, which can then be resumed.
        progress: Told of the points trained on, and of each epoch's metrics.

    Returns:
        What was made.

    Raises:
        BushsegError: The data set or the checkpoint is missing, damaged or doesn't fit.
    """
    trainer = Trainer(Dataset(data), _run_folder(run), config or Config(), progress)
    if resume:
        trainer.restore()
    return trainer.run(stop)


class Trainer:
    """One run: the network, its optimizer and how far they have come."""

    def __init__(
        self, dataset: Dataset, folder: Path, config: Config, progress: Progress = SILENT
    ) -> None:
        self.dataset = dataset
        self.folder = folder
        self.config = config.model_copy(update={"prepare": dataset.config})
        self.progress = progress
        self.state = TrainingState()
        self.train_tiles, self.held_out = dataset.split(config.train)
        self.card = _card(dataset, self.train_tiles, self.config)
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        with torch.random.fork_rng():
            torch.manual_seed(torch_seed(config.train.seed))
            self.network = build_network(self.card).to(self.device)
        counts = dataset.class_counts(self.train_tiles)
        self.weights = loss_weights(counts, config.train.class_weights).to(self.device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), config.train.learning_rate)
        wanted = set(self.train_tiles)
        self.crops = [n for n, tile in enumerate(dataset.crop_tiles) if tile in wanted]

    def restore(self) -> None:
        """Load the last checkpoint of this run.

        Raises:
            CheckpointError: There is none, or it was trained with other settings or data.
        """
        path = self.folder / LAST
        card, state, tensors = load_checkpoint(path)
        if card.model_copy(update={"metrics": {}}) != self.card:
            raise CheckpointError(
                f"{path}: was trained on other data or with other settings; resume with those of "
                f"{self.folder / SETTINGS}, or start a new run"
            )
        prefix = "network."
        weights = {n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)}
        try:
            self.network.load_state_dict(weights)
        except RuntimeError as error:
            raise CheckpointError(f"{path}: its weights don't fit its settings") from error
        restore_optimizer(self.network, self.optimizer, tensors)
        self.state = TrainingState.from_dict(state)

    def run(self, stop: Callable[[], bool]) -> TrainResult:
        """Train the epochs that are left."""
        settings = self.config.train
        with atomic_path(self.folder / SETTINGS) as partial:
            partial.write_text(self.config.to_toml(), encoding="utf-8")
        num_points, seconds, stopped = 0, 0.0, False
        while self.state.epoch < settings.epochs and not stopped:
            begun = time.perf_counter()
            points, stopped = self._epoch(stop)
            num_points, seconds = num_points + points, seconds + time.perf_counter() - begun
            if stopped:
                self._save(LAST)
            else:
                self._finish_epoch(points / max(time.perf_counter() - begun, 1e-9))
        return TrainResult(
            self.folder, self.state.epoch, self.state.history, stopped, num_points, seconds
        )

    def _epoch(self, stop: Callable[[], bool]) -> tuple[int, bool]:
        """Train the steps of this epoch that are left; says how many points, and if stopped."""
        settings, state = self.config.train, self.state
        for group in self.optimizer.param_groups:
            group["lr"] = settings.learning_rate * settings.decay**state.epoch
        self.network.train()
        confusion = state.confusion(self.dataset.scheme.num_classes)
        steps = self._steps()
        self.progress.start(
            f"epoch {state.epoch + 1}/{settings.epochs}",
            sum(map(len, steps)) * self.dataset.config.crop_points,
            "points",
        )
        num_points = 0
        for batch, labels in self._batches(steps[state.step :]):
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
        with torch.random.fork_rng():
            torch.manual_seed(torch_seed(self.config.train.seed, self.state.epoch, self.state.step))
            logits = self.network(batch)
        # A crop without a single label teaches nothing, and must not divide by zero.
        total = nn.functional.cross_entropy(
            logits, labels, self.weights, ignore_index=-1, reduction="sum"
        )
        known = labels[labels >= 0]
        loss = total / self.weights[known].sum().clamp_min(1e-12)
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        return float(loss.detach()), logits.detach()

    def _steps(self) -> list[list[int]]:
        """This epoch's crops, a list for each step."""
        settings = self.config.train
        if settings.fresh_crops:
            order = list(range(self.dataset.num_fresh(self.train_tiles)))
        else:
            rng = generator(settings.seed, self.state.epoch)
            order = [self.crops[index] for index in rng.permutation(len(self.crops))]
        size = settings.batch_size
        steps = [order[start : start + size] for start in range(0, len(order), size)]
        return steps[: settings.steps_per_epoch]

    def _batches(self, steps: Sequence[Sequence[int]]) -> Iterator[tuple[Batch, Tensor]]:
        """Load and augment; the next batch is made while the network works on this one."""
        samples = self._fresh() if self.config.train.fresh_crops else None
        first = self.state.step
        with ThreadPoolExecutor(max_workers=1) as pool:
            pending = None
            for number, step in enumerate(steps, start=first):
                following = pool.submit(self._batch, step, number, samples)
                if pending is not None:
                    yield pending.result()
                pending = following
            if pending is not None:
                yield pending.result()

    def _batch(
        self, step: Sequence[int], number: int, fresh: Iterator[Sample] | None
    ) -> tuple[Batch, Tensor]:
        settings, spacing = self.config.train, self.dataset.config.voxel_size
        rng = generator(settings.seed, self.state.epoch, number)
        batches, labels = [], []
        for crop in step:
            sample = self.dataset.cached_sample(crop) if fresh is None else next(fresh)
            sample = augment(sample, settings.augment, spacing, rng)
            features = feature_matrix(sample.features, self.card.features, len(sample.xyz))
            batches.append(
                Batch.from_numpy(features, sample.xyz, sample.normals, sample.pyramid, spacing)
            )
            labels.append(torch.from_numpy(sample.labels))
        return Batch.concatenated(batches).to(self.device), torch.cat(labels).to(self.device)

    def _fresh(self) -> Iterator[Sample]:
        """Crops drawn anew for this epoch; after a resume, those already seen are passed over."""
        sampler = self.dataset.sampler(
            self.train_tiles, generator(self.config.train.seed, self.state.epoch)
        )
        skipped = self.state.step * self.config.train.batch_size
        for number, crop in enumerate(sampler.draws(self.dataset.num_fresh(self.train_tiles))):
            if number >= skipped:
                yield self.dataset.fresh_sample(self.train_tiles[crop.tile], crop.indices)

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
            judged = validate(self.network, self.dataset, self.held_out, self.card, self.progress)
            row |= {"val_oa": judged.oa, "val_miou": judged.miou}
            row |= {f"val_iou/{n}": float(v) for n, v in zip(names, judged.iou, strict=True)}
        state.history.append({key: float(value) for key, value in row.items()})
        state.epoch, state.step, state.loss_sum, state.counts = state.epoch + 1, 0, 0.0, []
        metrics = {k: None if np.isnan(v) else v for k, v in state.history[-1].items()}
        self.card = self.card.model_copy(update={"metrics": metrics})
        score = 0.0 if np.isnan(judged.miou) else judged.miou
        if score > state.best:
            state.best = score
            save_model(self.folder / BEST, self.card, self.network)
        self._save(LAST)
        write_history(self.folder / METRICS, state.history)
        with atomic_path(self.folder / CURVES) as partial:
            plot_curves(state.history, partial)
        self.progress.note(_summary(state.history[-1], self.config.train.epochs))

    def _save(self, name: str) -> None:
        save_model(
            self.folder / name,
            self.card,
            self.network,
            extra=optimizer_tensors(self.network, self.optimizer),
            state=self.state.as_dict(),
        )


def loss_weights(class_counts: np.ndarray[tuple[int], np.dtype[np.int64]], how: str) -> Tensor:
    """Weight of each class in the loss, of mean 1 over the classes that occur.

    Args:
        class_counts: Labelled points per class, shape (C,).
        how: "sqrt" (1 / sqrt(f) of the class's share f), "inverse" (1 / f) or "none".

    Returns:
        Shape (C,), float32; 0 for a class that doesn't occur.
    """
    present = class_counts > 0
    shares = class_counts[present] / max(class_counts.sum(), 1)
    power = {"sqrt": -0.5, "inverse": -1.0, "none": 0.0}[how]
    weights = np.zeros(len(class_counts), dtype=np.float32)
    if present.any():
        weights[present] = shares**power / (shares**power).mean()
    return torch.from_numpy(weights)


def validate(
    network: BushNet,
    dataset: Dataset,
    tiles: Sequence[int],
    card: ModelCard,
    progress: Progress = SILENT,
) -> ConfusionMatrix:
    """Label whole tiles as `predict` would, each voxel once, and compare.

    Args:
        network: The network; left in evaluation mode.
        dataset: The data set.
        tiles: Indices of the held-out tiles.
        card: The model's card.
        progress: Told of the voxels labelled.

    Returns:
        Confusion of the tiles' labelled core voxels.
    """
    network.eval()
    confusion = ConfusionMatrix(dataset.scheme.num_classes)
    total = sum(dataset.tiles[number].core_size for number in tiles)
    progress.start("validating", total, "points")
    for number in tiles:
        tile = dataset.tile(number)
        logits = tile_logits(network, tile, card.features, dataset.config.voxel_size)
        confusion.update(logits.argmax(axis=1), tile.labels[tile.is_core])
        progress.advance(len(logits))
    return confusion


def write_history(path: Path, history: Sequence[dict[str, float]]) -> None:
    """One row an epoch, as CSV."""
    with atomic_path(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(history[0]))
        writer.writeheader()
        writer.writerows(history)


def _card(dataset: Dataset, tiles: Sequence[int], config: Config) -> ModelCard:
    distances = [dataset.tiles[number].neighbor_distance for number in tiles]
    droppable = DROPPABLE if config.train.augment.feature_dropout > 0 else ()
    return ModelCard(
        scheme=dataset.scheme,
        features=dataset.features,
        optional_features=tuple(name for name in dataset.features if name in droppable),
        prepare=dataset.config,
        network=config.network,
        neighbor_distance=(min(distances), max(distances)),
    )


def _run_folder(run: str | Path | None) -> Path:
    return Path(run) if run is not None else Path("runs") / f"{datetime.now():%Y-%m-%d_%H%M%S}"


def _summary(row: dict[str, float], epochs: int) -> str:
    """An epoch's metrics in one line."""
    parts = [f"epoch {row['epoch']:.0f}/{epochs}  loss {row['loss']:.3f}"]
    if "val_miou" in row:
        parts.append(f"held out: mIoU {row['val_miou']:.1%}, OA {row['val_oa']:.1%}")
        ious = {k.removeprefix("val_iou/"): v for k, v in row.items() if k.startswith("val_iou/")}
        parts.append(", ".join(f"{k} {v:.0%}" for k, v in ious.items() if not np.isnan(v)))
    else:
        parts.append(f"training crops: mIoU {row['train_miou']:.1%}, OA {row['train_oa']:.1%}")
    parts.append(f"{row['points_per_second']:,.0f} points/s")
    return "  ".join(parts)
