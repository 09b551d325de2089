"""Everything training needs to go on exactly where it stopped.

No random state is stored: every random number is drawn from a generator seeded by (seed, epoch,
step), so a step comes out the same whether or not the run was interrupted before it.
"""

from collections.abc import Mapping
from typing import Annotated, Self

import numpy as np
import torch
from pydantic import ConfigDict, Field, model_validator
from torch import Tensor

from bushseg.config import Section, TrainConfig
from bushseg.errors import CheckpointError
from bushseg.metrics import ConfusionMatrix
from bushseg.models.bushnet import BushNet

_OPTIMIZER = "optimizer."


Count = Annotated[int, Field(ge=0, lt=2**62)]


class TrainingState(Section):
    """How far training has come, and with which settings. Unlike settings, it changes."""

    model_config = ConfigDict(frozen=False)

    settings: TrainConfig = Field(description="What it is trained with")
    epoch: Count = Field(0, description="The epoch under way, from 0")
    step: Count = Field(0, description="Steps of it that are done")
    loss_sum: float = Field(0.0, description="Their losses, added up")
    counts: list[list[Count]] = Field([], description="Their confusion counts, row by row")
    best: float = Field(-1.0, description="The best score so far; -1 before the first")
    history: list[dict[str, float]] = Field([], description="One row for each finished epoch")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.history) != self.epoch:
            raise ValueError(f"expected one row of history for each of {self.epoch} epochs")
        return self

    @property
    def has_begun(self) -> bool:
        """Whether a step has been made, so that the optimizer holds moments."""
        return self.epoch > 0 or self.step > 0

    def confusion(self, num_classes: int) -> ConfusionMatrix:
        """The confusion matrix of the epoch under way.

        Raises:
            CheckpointError: The counts are those of another number of classes.
        """
        confusion = ConfusionMatrix(num_classes)
        if self.counts:
            if {len(self.counts), *map(len, self.counts)} != {num_classes}:
                raise CheckpointError(f"counts aren't those of {num_classes} classes")
            confusion.counts += np.array(self.counts, dtype=np.int64)
        return confusion


def generator(*numbers: int) -> np.random.Generator:
    """A generator for one purpose, named by numbers such as (seed, epoch, step)."""
    return np.random.default_rng(_named(numbers))


def torch_seed(*numbers: int) -> int:
    """A seed for torch, named likewise."""
    return int(np.random.SeedSequence(_named(numbers)).generate_state(1, np.uint64)[0] >> 1)


def _named(numbers: tuple[int, ...]) -> tuple[int, ...]:
    """Put the length first: to numpy's seeds (1,) and (1, 0) are the same."""
    return (len(numbers), *numbers)


def optimizer_tensors(network: BushNet, optimizer: torch.optim.Adam) -> dict[str, Tensor]:
    """Adam's moments and step counts by parameter name."""
    return {
        f"{_OPTIMIZER}{name}.{key}": value
        for name, parameter in network.named_parameters()
        for key, value in optimizer.state.get(parameter, {}).items()
    }


def restore_optimizer(
    network: BushNet, optimizer: torch.optim.Adam, tensors: Mapping[str, Tensor]
) -> None:
    """Put back what :func:`optimizer_tensors` took out.

    Raises:
        CheckpointError: A moment is missing, or has another shape or dtype than its parameter.
    """
    for name, parameter in network.named_parameters():
        moments = {}
        for key in ("step", "exp_avg", "exp_avg_sq"):
            value = tensors.get(f"{_OPTIMIZER}{name}.{key}")
            # Adam counts its steps on the processor, in float32, wherever the parameter lives.
            like = torch.tensor(0.0) if key == "step" else parameter
            if value is None or value.shape != like.shape or value.dtype != like.dtype:
                found = "missing" if value is None else f"{tuple(value.shape)} {value.dtype}"
                raise CheckpointError(
                    f"{key} of {name} is {found}; expected {tuple(like.shape)} {like.dtype}"
                )
            moments[key] = value.to(like.device)
        optimizer.state[parameter] = moments
