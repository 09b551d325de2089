"""The network that learns: its optimizer, its loss, one step at a time.

Where several processes train together, each has the same network and its share of a step's crops.
What is summed over crops (statistics of normalization, loss, gradients, counts) is summed over all
processes, so that they come to the weights that one would come to with all the crops.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bushseg.checkpoint import ModelCard, build_network, network_weights
from bushseg.config import TrainConfig
from bushseg.errors import CheckpointError
from bushseg.loss import total_weight, weighted_cross_entropy
from bushseg.metrics import ConfusionMatrix
from bushseg.models.batch import Batch
from bushseg.models.precision import multiplying_in
from bushseg.ranks import current
from bushseg.stages import Stages
from bushseg.training_state import optimizer_tensors, restore_optimizer, torch_seed


@dataclass(frozen=True, slots=True)
class Step:
    """What one step found.

    Attributes:
        loss: The loss before the update.
        confusion: Its labelled points.
        num_points: Its points.

    All are of all processes' crops.
    """

    loss: float
    confusion: ConfusionMatrix
    num_points: int


class Learner:
    """A network in training.

    Attributes:
        network: The network.

    Args:
        card: What network to build.
        config: How it learns.
        weights: Of each class in the loss, (C,).
        stages: Told how long the parts of a step take.
    """

    def __init__(
        self, card: ModelCard, config: TrainConfig, weights: Tensor, stages: Stages
    ) -> None:
        self._config, self._stages = config, stages
        self._ranks = current()
        self._device = self._ranks.device
        with torch.random.fork_rng():
            torch.manual_seed(torch_seed(config.seed))
            self.network = build_network(card).to(self._device)
        self._weights = weights.to(self._device)
        self._optimizer = torch.optim.Adam(self.network.parameters(), config.learning_rate)

    @property
    def learning_rate(self) -> float:
        """The rate of the epoch under way."""
        return float(self._optimizer.param_groups[0]["lr"])

    def begin_epoch(self, epoch: int) -> None:
        """Make ready for the steps of an epoch, counted from 0."""
        for group in self._optimizer.param_groups:
            group["lr"] = self._config.learning_rate * self._config.decay**epoch
        self.network.train()

    def step(self, batch: Batch, labels: Tensor, epoch: int, step: int) -> Step:
        """One forward, backward and update.

        Args:
            batch: What the network is shown.
            labels: (N,) int64.
            epoch: The epoch under way, from 0.
            step: Which of its steps, from 0.
        """
        timed, known, total = self._stages.timed, labels.to(self._device), self._ranks.total
        weight = total(total_weight(known, self._weights))
        with multiplying_in(self._config.precision):
            with timed("forward"), torch.random.fork_rng():
                torch.manual_seed(torch_seed(self._config.seed, epoch, step))
                logits = self.network(batch.to(self._device))
                loss = weighted_cross_entropy(logits, known, self._weights, weight)
            with timed("backward"):
                self._optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                self._add_gradients()
            with timed("update"):
                self._optimizer.step()
        confusion = ConfusionMatrix(logits.shape[1])
        confusion.update(logits.detach().argmax(dim=1).cpu().numpy(), labels.numpy())
        counts = total(torch.from_numpy(np.append(confusion.counts.ravel(), len(labels))))
        confusion.counts[:] = counts[:-1].view(confusion.counts.shape).numpy()
        return Step(float(total(loss.detach())), confusion, int(counts[-1]))

    def _add_gradients(self) -> None:
        """Add up all processes' gradients."""
        if self._ranks.size == 1:
            return
        parameters = list(self.network.parameters())
        for parameter in parameters:
            if parameter.grad is None:  # no crop of this process came by
                parameter.grad = torch.zeros_like(parameter)
        gradients = [parameter.grad for parameter in parameters if parameter.grad is not None]
        summed = self._ranks.total(torch.cat([gradient.flatten() for gradient in gradients]))
        parts = torch.split(summed, [gradient.numel() for gradient in gradients])
        for gradient, part in zip(gradients, parts, strict=True):
            gradient.copy_(part.view_as(gradient))

    def share_weights(self) -> None:
        """Begin with the first process's weights: another machine's might differ by a rounding."""
        for tensor in self.network.state_dict().values():
            self._ranks.from_first(tensor)

    def optimizer_tensors(self) -> dict[str, Tensor]:
        """What the optimizer has to remember, by name."""
        return optimizer_tensors(self.network, self._optimizer)

    def restore(self, tensors: Mapping[str, Tensor], *, has_begun: bool) -> None:
        """Take over a checkpoint's weights and the optimizer's memory.

        Args:
            tensors: All that the checkpoint holds.
            has_begun: Whether a step had been made: the optimizer remembers nothing before.

        Raises:
            CheckpointError: A tensor is missing, or another than expected.
        """
        try:
            self.network.load_state_dict(network_weights(tensors))
        except RuntimeError as error:
            raise CheckpointError(str(error).splitlines()[-1].strip()) from error
        if has_begun:
            restore_optimizer(self.network, self._optimizer, tensors)
