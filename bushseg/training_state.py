"""Everything training needs to go on exactly where it stopped.

No random state is stored: every random number is drawn from a generator seeded by (seed, epoch,
step), so a step comes out the same whether or not the run was interrupted before it.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bushseg.errors import CheckpointError
from bushseg.metrics import ConfusionMatrix
from bushseg.models.bushnet import BushNet

_OPTIMIZER = "optimizer."


@dataclass
class TrainingState:
    """How far training has come.

    Attributes:
        epoch: The epoch under way, from 0.
        step: Steps of it that are done.
        loss_sum: Their losses, added up.
        counts: Their confusion counts, row by row.
        best: The best validation score so far; -1 before the first.
        history: One row of metrics for each finished epoch.
    """

    epoch: int = 0
    step: int = 0
    loss_sum: float = 0.0
    counts: list[list[int]] = field(default_factory=list)
    best: float = -1.0
    history: list[dict[str, float]] = field(default_factory=list)

    def confusion(self, num_classes: int) -> ConfusionMatrix:
        """The confusion matrix of the epoch under way."""
        confusion = ConfusionMatrix(num_classes)
        if self.counts:
            confusion.counts += np.array(self.counts, dtype=np.int64)
        return confusion

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "TrainingState":
        """The inverse of :meth:`as_dict`.

        Raises:
            CheckpointError: The values are no training state.
        """
        try:
            return cls(**values)
        except TypeError as error:
            raise CheckpointError(f"the file holds no training state ({error})") from error


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
        CheckpointError: A moment has another shape than its parameter.
    """
    for name, parameter in network.named_parameters():
        prefix = f"{_OPTIMIZER}{name}."
        moments = {k.removeprefix(prefix): t for k, t in tensors.items() if k.startswith(prefix)}
        for key, value in moments.items():
            if key != "step" and value.shape != parameter.shape:
                raise CheckpointError(
                    f"optimizer state of {name} is {tuple(value.shape)}; expected "
                    f"{tuple(parameter.shape)}"
                )
        if moments:
            optimizer.state[parameter] = moments
