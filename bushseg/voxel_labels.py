"""Labels of all voxels of a scan, tile by tile; what an earlier run did is not done again."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.errors import CacheError
from bushseg.labeler import check_features, label_tile
from bushseg.progress import Progress
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.stitch import Stitcher
from bushseg.tile_labels import TileLabels
from bushseg.tiling import Tile, Tiling


@dataclass(frozen=True, slots=True)
class VoxelLabels:
    """What a model said of a scan.

    Attributes:
        stitcher: The labels of all voxels.
        num_seen: Voxels that passed the network, halos included.
        neighbor_distance: Median distance to the K-th neighbor, metres.
    """

    stitcher: Stitcher
    num_seen: int
    neighbor_distance: float


def label_voxels(
    model: Model,
    scan: VoxelScan,
    tiling: Tiling,
    config: PredictConfig,
    place: Path,
    progress: Progress,
    stages: Stages,
) -> VoxelLabels:
    """Label a scan's voxels.

    Args:
        model: The model.
        scan: The scan at the model's voxel size.
        tiling: How it is cut.
        config: Precision.
        place: Where finished tiles are kept, if the scan has more than one.
        progress: Told of the voxels labelled.
        stages: Told of the time that each step takes.

    Raises:
        DataError: The scan lacks a feature that the model can't do without.
        WriteError: A finished tile can't be kept.
    """
    check_features(model.card, scan)
    scheme = model.card.scheme
    with stages.timed("look up"):
        stitcher = Stitcher(scan.voxels, scheme.bush_index)
    progress.start("labelling", len(scan.voxels), "voxels")
    num_seen, distances, sizes = 0, [], []
    for number, tile in enumerate(tiling.tiles):
        path = place / f"tile_{number:06d}.safetensors"
        labels = None
        if len(tiling.tiles) > 1:
            labels = _finished(path, tile, model)
        if labels is None:
            predicted = label_tile(model, scan, tiling, tile, config, stages)
            labels = TileLabels.of(predicted, scheme.bush_index)
            if len(tiling.tiles) > 1:
                with stages.timed("keep tiles"):
                    labels.save(path)
        with stages.timed("look up"):
            stitcher.add(tiling.core(tile), labels)
        num_seen += labels.num_seen
        distances.append(labels.neighbor_distance)
        sizes.append(tile.num_points)
        progress.advance(tile.num_points)
    return VoxelLabels(stitcher, num_seen, _weighted_median(distances, sizes))


def _finished(path: Path, tile: Tile, model: Model) -> TileLabels | None:
    """A tile's labels, if an earlier run left them."""
    if not path.exists():
        return None
    scheme = model.card.scheme
    try:
        return TileLabels.load(
            path, tile.num_points, scheme.num_classes, has_bush=scheme.bush_index is not None
        )
    except CacheError:  # damaged: it is done again
        return None


def _weighted_median(values: list[float], weights: list[int]) -> float:
    """Median of values that stand for so many points each."""
    order = np.argsort(values)
    running = np.cumsum(np.array(weights)[order])
    return values[order[int(np.searchsorted(running, running[-1] / 2))]]
