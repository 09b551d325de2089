"""What training feeds the network, step by step.

Everything random is drawn from a generator named by (seed, epoch, step, crop), so that an epoch
taken up in the middle gives the batches it would have given, and several processes that each take
their share of a batch are shown what one would be.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor

from bushseg.augment import augment
from bushseg.config import TrainConfig
from bushseg.dataset import Dataset, Sample
from bushseg.features import FEATURES
from bushseg.inference import feature_matrix
from bushseg.models.batch import Batch
from bushseg.ranks import current
from bushseg.training_state import generator


class EpochBatches:
    """The batches of one epoch, or this process's shares of them.

    Args:
        dataset: The data set.
        tiles: Indices of the training tiles.
        features: The network's features, in order.
        config: Training settings.
        epoch: Which epoch, from 0.
    """

    def __init__(
        self,
        dataset: Dataset,
        tiles: Sequence[int],
        features: Sequence[str],
        config: TrainConfig,
        epoch: int,
    ) -> None:
        self._dataset = dataset
        self._tiles = tiles
        self._features = features
        self._config = config
        self._epoch = epoch
        crops = self._crops()
        size = config.batch_size
        steps = [crops[start : start + size] for start in range(0, len(crops), size)]
        self._steps = steps[: config.steps_per_epoch]

    @property
    def num_crops(self) -> int:
        """Crops in the whole epoch, of all processes."""
        return sum(map(len, self._steps))

    def __len__(self) -> int:
        return len(self._steps)

    def start(self, first: int = 0) -> Iterator[tuple[Batch, Tensor]]:
        """Load and augment batches; the next is made while the network works on this one.

        Args:
            first: Step to begin with.

        Yields:
            A batch, and its labels (N,) int64: of this process's share of the step's crops, which
            may be none.
        """
        fresh = self._fresh(first) if self._config.fresh_crops else None
        with ThreadPoolExecutor(max_workers=1) as pool:
            pending = None
            for step in range(first, len(self._steps)):
                following = pool.submit(self._batch, step, fresh)
                if pending is not None:
                    yield pending.result()
                pending = following
            if pending is not None:
                yield pending.result()

    def _crops(self) -> list[int]:
        """Numbers of this epoch's crops, in the order they are shown."""
        if self._config.fresh_crops:
            return list(range(self._dataset.num_fresh(self._tiles)))
        wanted = set(self._tiles)
        data = self._dataset
        # A crop without a label teaches nothing: most have none where
        # a few bushes were painted.
        crops = [
            number
            for number, tile in enumerate(data.crop_tiles)
            if tile in wanted and data.crop_labelled[number]
        ]
        order = generator(self._config.seed, self._epoch).permutation(len(crops))
        return [crops[index] for index in order]

    def _fresh(self, first: int) -> Iterator[Sample]:
        """Crops drawn anew for this epoch; those of steps already done are passed over.

        So are crops without a label. As each draw takes the point least seen, labelled ones come.
        """
        rng = generator(self._config.seed, self._epoch)
        sampler = self._dataset.sampler(self._tiles, rng)
        skipped = first * self._config.batch_size
        number = 0
        while number < self.num_crops:
            crop = sampler.draw()
            tile = self._tiles[crop.tile]
            if not (self._dataset.tile(tile).labels[crop.indices] >= 0).any():
                continue
            step, place = divmod(number, self._config.batch_size)
            if number >= skipped and place in self._share(step):
                yield self._dataset.fresh_sample(tile, crop.indices)
            number += 1

    def _share(self, step: int) -> range:
        """Which of a step's crops are this process's, by their places in the batch."""
        return current().share(len(self._steps[step]))

    def _batch(self, step: int, fresh: Iterator[Sample] | None) -> tuple[Batch, Tensor]:
        data, spacing = self._dataset, self._dataset.config.voxel_size
        batches, labels = [], []
        for place in self._share(step):
            crop = self._steps[step][place]
            sample = data.cached_sample(crop) if fresh is None else next(fresh)
            rng = generator(self._config.seed, self._epoch, step, place)
            sample = augment(sample, self._config.augment, spacing, rng)
            features = feature_matrix(sample.features, self._features, len(sample.xyz))
            batches.append(
                Batch.from_numpy(features, sample.xyz, sample.normals, sample.pyramid, spacing)
            )
            labels.append(torch.from_numpy(sample.labels))
        if not batches:
            width = sum(FEATURES[name] for name in self._features)
            nothing = Batch.empty(width, data.config.num_neighbors, data.config.num_levels)
            return nothing, torch.empty(0, dtype=torch.int64)
        return Batch.concatenated(batches), torch.cat(labels)
