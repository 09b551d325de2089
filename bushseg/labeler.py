"""A model applied to a whole scan, tile by tile; each voxel passes the network about once."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.checkpoint import Model, ModelCard
from bushseg.config import PredictConfig
from bushseg.errors import DataError
from bushseg.inference import probabilities, tile_logits
from bushseg.memory import HALO
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.tile_data import cut_tile
from bushseg.tiling import Tile, Tiling


@dataclass(frozen=True, slots=True)
class TilePrediction:
    """The network's answer for one tile's core.

    Attributes:
        indices: Core voxels, indices into the scan's voxels, (M,) int64.
        probabilities: Per class, (M, C) float32.
        num_seen: Voxels that passed the network for it, halo included.
        neighbor_distance: Median distance to the K-th neighbor in the tile, metres.
    """

    indices: NDArray[np.int64]
    probabilities: NDArray[np.float32]
    num_seen: int
    neighbor_distance: float


def cut(model: Model, scan: VoxelScan, config: PredictConfig) -> Tiling:
    """How a scan is cut for a model; to keep within memory, halos count towards a tile's size."""
    halo = model.card.prepare.halo if config.halo is None else config.halo
    most = None if config.max_memory is None else int(HALO * config.tile_points)
    return Tiling(scan.voxels.keys, config.tile_points, halo, scan.voxels.scratch, most)


def label_tile(
    model: Model,
    scan: VoxelScan,
    tiling: Tiling,
    tile: Tile,
    config: PredictConfig,
    stages: Stages,
) -> TilePrediction:
    """Label one tile.

    Args:
        model: The model.
        scan: The scan at the model's voxel size.
        tiling: How it is cut.
        tile: Which tile.
        config: Precision.
        stages: Told of the time that tiling, neighbors, normals and the network take.
    """
    card = model.card
    data = cut_tile(scan, tiling, tile, card.prepare, stages)
    with stages.timed("network"):
        logits = tile_logits(
            model.network, data, card.features, card.prepare.voxel_size, config.precision
        )
        found = probabilities(logits, card.temperature)
    return TilePrediction(
        indices=data.indices[data.is_core],
        probabilities=found,
        num_seen=len(data),
        neighbor_distance=data.neighbor_distance(),
    )


def label_tiles(
    model: Model, scan: VoxelScan, config: PredictConfig, stages: Stages | None = None
) -> Iterator[TilePrediction]:
    """Label a scan tile by tile; the cores cover every voxel exactly once.

    Args:
        model: The model.
        scan: The scan at the model's voxel size.
        config: Tile size, halo and precision.
        stages: Told of the time that tiling, neighbors, normals and the network take.

    Yields:
        One prediction a tile.

    Raises:
        DataError: The scan lacks a feature that the model can't do without.
    """
    check_features(model.card, scan)
    stages = stages or Stages()
    with stages.timed("tiling"):
        tiling = cut(model, scan, config)
    for tile in tiling.tiles:
        yield label_tile(model, scan, tiling, tile, config, stages)


def check_features(card: ModelCard, scan: VoxelScan) -> None:
    """Refuse a scan that lacks what the model can't do without.

    Raises:
        DataError: It names what both have.
    """
    missing = [name for name in card.features if name not in scan.features]
    needed = [name for name in missing if name not in card.optional_features]
    if needed:
        raise DataError(
            f"the model needs {', '.join(card.features)}, the scan has {', '.join(scan.features)}: "
            f"{', '.join(needed)} is missing; use a model trained without it"
        )
