"""A model applied to a whole scan, tile by tile; each voxel passes the network about once."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.errors import DataError
from bushseg.inference import probabilities, tile_logits
from bushseg.progress import SILENT, Progress
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.tile_data import cut_tile
from bushseg.tiling import Tiling

_DENSITY_MARGIN = 1.5


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


def label_tiles(
    model: Model,
    scan: VoxelScan,
    config: PredictConfig,
    progress: Progress = SILENT,
    stages: Stages | None = None,
) -> Iterator[TilePrediction]:
    """Label a scan tile by tile; the cores cover every voxel exactly once.

    Args:
        model: The model.
        scan: The scan at the model's voxel size.
        config: Tile size and halo.
        progress: Told of the voxels labelled.
        stages: Told of the time that tiling, neighbors, normals and the network take.

    Yields:
        One prediction a tile.

    Raises:
        DataError: The scan lacks a feature that the model can't do without.
    """
    check_features(model, scan)
    card = model.card
    halo = card.prepare.halo if config.halo is None else config.halo
    stages = stages or Stages()
    with stages.timed("tiling"):
        tiling = Tiling(scan.voxels.keys, config.tile_points, halo)
    progress.start("labelling", len(scan.voxels), "voxels")
    for tile in tiling.tiles:
        data = cut_tile(scan, tiling, tile, card.prepare, stages)
        with stages.timed("network"):
            logits = tile_logits(
                model.network, data, card.features, card.prepare.voxel_size, config.precision
            )
            found = probabilities(logits)
        yield TilePrediction(
            indices=data.indices[data.is_core],
            probabilities=found,
            num_seen=len(data),
            neighbor_distance=data.neighbor_distance(),
        )
        progress.advance(tile.num_points)


def check_features(model: Model, scan: VoxelScan) -> None:
    """Refuse a scan that lacks what the model can't do without.

    Raises:
        DataError: It names what both have.
    """
    card = model.card
    missing = [name for name in card.features if name not in scan.features]
    needed = [name for name in missing if name not in card.optional_features]
    if needed:
        raise DataError(
            f"the model needs {', '.join(card.features)}, the scan has {', '.join(scan.features)}: "
            f"{', '.join(needed)} is missing; use a model trained without it"
        )


def domain_warnings(model: Model, scan: VoxelScan, neighbor_distance: float) -> list[str]:
    """What about a scan lies outside what the model was trained on.

    Args:
        model: The model.
        scan: The scan.
        neighbor_distance: The scan's median distance to the K-th neighbor, metres.

    Returns:
        One line a concern.
    """
    card, warnings = model.card, []
    missing = [name for name in card.features if name not in scan.features]
    if missing:
        warnings.append(
            f"the scan has no {' and no '.join(missing)}, which the model was trained with; "
            "it does without, less surely"
        )
    low, high = card.neighbor_distance
    if not low / _DENSITY_MARGIN <= neighbor_distance <= high * _DENSITY_MARGIN:
        sparser = "sparser" if neighbor_distance > high else "denser"
        warnings.append(
            f"the scan is {sparser} than the model's training data: {card.prepare.num_neighbors} "
            f"neighbors within {neighbor_distance:.2f} m, in training {low:.2f} to {high:.2f} m; "
            "its labels may mean little"
        )
    return warnings
