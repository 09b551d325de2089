"""What a training run writes into its folder, and when."""

import time
from collections.abc import Sequence
from pathlib import Path

from bushseg.checkpoint import ModelCard, load_checkpoint, save_model
from bushseg.config import Config, first_difference
from bushseg.errors import CheckpointError, ConfigError
from bushseg.files import atomic_path
from bushseg.history import write_history
from bushseg.learner import Learner
from bushseg.plots import plot_curves
from bushseg.runs import BEST, CURVES, LAST, METRICS, SETTINGS
from bushseg.training_state import TrainingState

_CURVES_SECONDS = 20.0
"""Drawing takes about a second: curves are drawn no more often than this, and at the end."""

_FREE = ("epochs", "checkpoint_minutes", "rank_timeout")
"""Settings that don't change the epochs that are done: those of a resumed run may differ."""


class RunFiles:
    """A run's folder, written to.

    Args:
        folder: The folder; created with the first file.
        checkpoint_minutes: How often to save within an epoch.
    """

    def __init__(self, folder: Path, checkpoint_minutes: float) -> None:
        self._folder, self._save_seconds = folder, 60 * checkpoint_minutes
        self._drawn_at = self._saved_at = time.monotonic()
        self._undrawn: Sequence[dict[str, float]] = ()

    def save_settings(self, config: Config) -> None:
        """Write every setting as it was resolved."""
        with atomic_path(self._folder / SETTINGS) as partial:
            partial.write_text(config.to_toml(), encoding="utf-8")

    @property
    def is_due(self) -> bool:
        """Whether the last checkpoint is so old that an epoch under way should be saved."""
        return time.monotonic() - self._saved_at >= self._save_seconds

    def save_last(self, card: ModelCard, learner: Learner, state: TrainingState) -> None:
        """Write all that is needed to go on from here."""
        save_model(
            self._folder / LAST,
            card,
            learner.network,
            extra=learner.optimizer_tensors(),
            state=state.model_dump(),
        )
        self._saved_at = time.monotonic()

    def save_best(self, card: ModelCard, learner: Learner) -> None:
        """Write the model, to be used."""
        save_model(self._folder / BEST, card, learner.network)

    def save_history(self, history: Sequence[dict[str, float]]) -> None:
        """Write the table of all epochs, and draw it unless that was done just now."""
        write_history(self._folder / METRICS, history)
        self._undrawn = history
        if time.monotonic() - self._drawn_at >= _CURVES_SECONDS:
            self.finish()

    def catch_up(self, history: Sequence[dict[str, float]]) -> None:
        """Write what a run that was killed after its checkpoint had not come to."""
        table, curves = self._folder / METRICS, self._folder / CURVES
        rows = len(table.read_bytes().splitlines()) - 1 if table.exists() else 0
        is_stale = rows != len(history) or not curves.exists()
        if history and (is_stale or curves.stat().st_mtime_ns < table.stat().st_mtime_ns):
            self.save_history(history)

    def finish(self) -> None:
        """Draw what is not drawn yet."""
        if self._undrawn:
            plot_curves(self._undrawn, self._folder / CURVES)
            self._drawn_at, self._undrawn = time.monotonic(), ()


def restore(
    folder: Path, card: ModelCard, config: Config, learner: Learner
) -> tuple[ModelCard, TrainingState]:
    """Load the last checkpoint of a run.

    Args:
        folder: The run's folder.
        card: What is to be trained.
        config: With which settings.
        learner: Takes over the weights.

    Returns:
        The card and the state to go on with.

    Raises:
        CheckpointError: There is none, or it was trained with other settings or data.
    """
    path, settings = folder / LAST, config.train
    if not path.is_file():
        raise CheckpointError(
            f"{path}: no such file: the run never came to its first checkpoint, or is another "
            "folder's; start it without --resume"
        )
    found, values, tensors = load_checkpoint(path)
    try:
        state = TrainingState.from_dict(values, "training state")
        state.confusion(found.scheme.num_classes)
    except (CheckpointError, ConfigError) as error:
        raise CheckpointError(f"{path}: can't be resumed ({error}); start a new run") from error
    before = state.settings.model_copy(update={name: getattr(settings, name) for name in _FREE})
    # What is found out in training, and which weights it began with, are the run's own.
    kept = {"temperature": found.temperature, "pretrained": found.pretrained}
    card = card.model_copy(update=kept)
    found = found.model_copy(update={"metrics": {}, "confidence": None})
    if changed := first_difference(found, card) or first_difference(before, settings):
        raise CheckpointError(
            f"{path}: {changed}; resume with the data and the settings it was trained with "
            f"({folder / SETTINGS}), or start a new run"
        )
    try:
        learner.restore(tensors, has_begun=state.has_begun)
    except CheckpointError as error:
        raise CheckpointError(f"{path}: is damaged ({error}); start a new run") from error
    return card, state.model_copy(update={"settings": settings})
