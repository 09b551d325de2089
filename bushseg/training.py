"""Training: prepared crops in; checkpoints, metrics and curves out, into a run's folder."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from bushseg.config import Config, TrainConfig
from bushseg.dataset import Dataset
from bushseg.errors import ConfigError
from bushseg.locks import locked
from bushseg.progress import SILENT, Progress
from bushseg.ranks import joined
from bushseg.runs import SETTINGS, check_new, name_run, remove_leftovers, remove_run
from bushseg.trainer import Trainer, TrainResult


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

    Processes that torchrun started train together, each on its share of every batch, to the weights
    that one would come to. The data set and the run lie in folders that all of them see; the first
    alone writes.

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
        WriteError: The folder holds a run that is neither to be resumed nor overwritten, or another
            process trains in it.
        BushsegError: The data set or the checkpoint is missing, damaged or doesn't fit.
    """
    if resume and (overwrite or run is None or pretrained is not None):
        raise ConfigError(
            "resume needs the folder of the run, and can neither overwrite it nor begin anew"
        )
    folder = name_run(run)
    if config is None:
        config = Config.load(folder / SETTINGS) if resume else Config()
    if pretrained is not None:
        given = config.train.model_dump(exclude_unset=True) | {"pretrained": str(pretrained)}
        config = config.model_copy(update={"train": TrainConfig.from_dict(given)})
    with joined(config.train.rank_timeout) as ranks, ExitStack() as held:
        if ranks.is_first:
            held.enter_context(locked(folder))
            if not resume:
                check_new(folder, overwrite=overwrite)
            remove_leftovers(folder)
        ranks.wait()  # for the first to have the folder
        shown = progress if ranks.is_first else SILENT
        trainer = Trainer(Dataset(data), folder, config, shown, resume=resume)
        if overwrite and ranks.is_first:
            remove_run(folder)
        return trainer.run(stop)
