"""How good a network is on tiles it has not seen, and how sure it may be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from bushseg.calibration import MIN_LABELS, ConfidenceBins, confidences, fit_temperature
from bushseg.checkpoint import ModelCard
from bushseg.dataset import Dataset
from bushseg.inference import tile_logits
from bushseg.metrics import ConfusionMatrix
from bushseg.models.bushnet import BushNet
from bushseg.progress import SILENT, Progress
from bushseg.ranks import current

_FITTED = 200_000
"""Labelled voxels, at most, that a temperature is fitted on: one number needs no more."""


@dataclass(frozen=True, slots=True)
class Validation:
    """What held-out tiles say about a network.

    Attributes:
        confusion: Confusion of their labelled core voxels.
        temperature: What to divide the network's logits by; the card's, where too few voxels are
            labelled to tell.
        ece: Expected calibration error without that temperature.
        calibrated_ece: And with it.
        confidence: Mean confidence with it; None without labelled voxels.
    """

    confusion: ConfusionMatrix
    temperature: float
    ece: float
    calibrated_ece: float
    confidence: float | None


def validate(
    network: BushNet,
    dataset: Dataset,
    tiles: Sequence[int],
    card: ModelCard,
    progress: Progress = SILENT,
) -> Validation:
    """Label whole tiles as `predict` would, each voxel once, and compare.

    Where several processes train together, each labels its share of the tiles.

    Args:
        network: The network; left in evaluation mode.
        dataset: The data set.
        tiles: Indices of the held-out tiles.
        card: The model's card.
        progress: Told of the voxels labelled.

    Returns:
        Scores, and the temperature that suits the labelled core voxels, an even share of each tile
        where there are very many. It is one number: fitting it on what it is judged on flatters it
        little.
    """
    network.eval()
    ranks, own = current(), _own_tiles(dataset, tiles)
    confusion = ConfusionMatrix(dataset.scheme.num_classes)
    total = sum(dataset.tiles[number].core_size for number in own)
    stride = max(1, -(-int(dataset.class_counts(tiles).sum()) // _FITTED))
    kept_logits = [np.empty((0, confusion.num_classes), dtype=np.float32)]
    kept_labels = [np.empty(0, dtype=np.int16)]
    progress.start("validating", total, "voxels")
    for number in own:
        tile = dataset.network_tile(number)
        logits = tile_logits(network, tile, card.features, dataset.config.voxel_size)
        labels = tile.labels[tile.is_core]
        confusion.update(logits.argmax(axis=1), labels)
        chosen = np.flatnonzero(labels >= 0)[::stride]
        kept_logits.append(logits[chosen])
        kept_labels.append(labels[chosen])
        progress.advance(len(logits))
    confusion.counts[:] = ranks.total(torch.from_numpy(confusion.counts)).numpy()
    judged_logits = ranks.rows_of_all(torch.from_numpy(np.concatenate(kept_logits))).numpy()
    judged_labels = ranks.rows_of_all(torch.from_numpy(np.concatenate(kept_labels)).int()).numpy()
    return _calibrate(confusion, judged_logits, judged_labels, card.temperature)


def _own_tiles(dataset: Dataset, tiles: Sequence[int]) -> list[int]:
    """This process's share of tiles: each next largest goes to whoever has least to do."""
    ranks = current()
    loads, own = [0] * ranks.size, []
    for number in sorted(tiles, key=lambda tile: -dataset.tiles[tile].core_size):
        least = loads.index(min(loads))
        loads[least] += dataset.tiles[number].core_size
        if least == ranks.rank:
            own.append(number)
    return sorted(own)


def _calibrate(
    confusion: ConfusionMatrix,
    logits: NDArray[np.float32],
    labels: NDArray[np.int32],
    temperature: float,
) -> Validation:
    """Fit the temperature, and count how far confidence is off without and with it."""
    if len(labels) >= MIN_LABELS:
        temperature = fit_temperature(logits, labels)
    before, after = ConfidenceBins(), ConfidenceBins()
    if len(labels):
        is_correct = logits.argmax(axis=1) == labels
        before.update(confidences(logits, 1.0), is_correct)
        after.update(confidences(logits, temperature), is_correct)
    confidence = after.mean_confidence if len(labels) else None
    return Validation(confusion, temperature, before.error, after.error, confidence)
