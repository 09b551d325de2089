"""How good a network is on tiles it has not seen."""

from collections.abc import Sequence

from bushseg.checkpoint import ModelCard
from bushseg.dataset import Dataset
from bushseg.inference import tile_logits
from bushseg.metrics import ConfusionMatrix
from bushseg.models.bushnet import BushNet
from bushseg.progress import SILENT, Progress


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
    progress.start("validating", total, "voxels")
    for number in tiles:
        tile = dataset.tile(number)
        logits = tile_logits(network, tile, card.features, dataset.config.voxel_size)
        confusion.update(logits.argmax(axis=1), tile.labels[tile.is_core])
        progress.advance(len(logits))
    return confusion
