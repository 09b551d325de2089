"""The card of a model that is to be trained: what its data are like."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from bushseg.augment import DROPPABLE
from bushseg.checkpoint import ModelCard
from bushseg.config import Config
from bushseg.dataset import Dataset


def describe_data(dataset: Dataset, tiles: Sequence[int], config: Config) -> ModelCard:
    """The card of a network trained on some tiles of a data set.

    Args:
        dataset: The data set.
        tiles: Indices of the tiles to train on, at least one.
        config: All settings.
    """
    distances = [dataset.tiles[number].neighbor_distance for number in tiles]
    profiles = np.array([dataset.tiles[number].height_profile for number in tiles])
    spared = set(dataset.partial_features)
    if config.train.augment.feature_dropout > 0:
        spared |= set(DROPPABLE)
    return ModelCard(
        scheme=dataset.scheme,
        features=dataset.features,
        optional_features=tuple(name for name in dataset.features if name in spared),
        prepare=dataset.config,
        network=config.network,
        neighbor_distance=(min(distances), max(distances)),
        heights=(float(profiles[:, 0].min()), float(profiles[:, 1].max())),
        low_share=_least_low_share(dataset, tiles),
    )


def _least_low_share(dataset: Dataset, tiles: Sequence[int]) -> float:
    """The least share of voxels near the ground that any scan's tiles have together."""
    near: dict[int, float] = defaultdict(float)
    total: dict[int, int] = defaultdict(int)
    for tile in (dataset.tiles[number] for number in tiles):
        near[tile.scan] += tile.height_profile[2] * tile.core_size
        total[tile.scan] += tile.core_size
    return min(near[scan] / total[scan] for scan in near)
