"""Labels of all voxels of a scan, tile by tile; what an earlier run did is not done again."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.bundled import file_hash
from bushseg.checkpoint import Model, save_model
from bushseg.config import PredictConfig
from bushseg.errors import CacheError, WorkerError
from bushseg.grid import BLOCK
from bushseg.jobs import LABEL_TILE, Scheduler
from bushseg.labeler import check_features, label_tile
from bushseg.memory import give_back
from bushseg.progress import Progress
from bushseg.scan import VoxelScan
from bushseg.schedulers import run_twice, wait_until_seen
from bushseg.stages import Stages
from bushseg.stitch import Stitcher
from bushseg.tile_labels import TileLabels, tile_path
from bushseg.tiling import Tile, Tiling

_MODEL = "model.safetensors"


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
    scheduler: Scheduler | None = None,
) -> VoxelLabels:
    """Label a scan's voxels.

    Args:
        model: The model.
        scan: The scan at the model's voxel size.
        tiling: How it is cut.
        config: Precision.
        place: Where finished tiles are kept, if the scan has more than one; with a scheduler, where
            the scan itself is stored.
        progress: Told of the voxels labelled.
        stages: Told of the time that each step takes.
        scheduler: Has the tiles labelled by other processes; None labels them here.

    Raises:
        DataError: The scan lacks a feature that the model can't do without.
        WorkerError: A tile's process died twice; the other tiles are done and kept.
        WriteError: A finished tile can't be kept.
    """
    check_features(model.card, scan)
    with stages.timed("look up"):
        stitcher = Stitcher(scan.voxels, model.card.scheme.bush_index)
    progress.start("labelling", len(scan.voxels), "voxels")
    labelled = _Labelling(model, scan, tiling, config, place, stages)
    num_seen, distances = 0, np.empty(len(tiling.tiles))
    found = labelled.here() if scheduler is None else labelled.elsewhere(scheduler)
    for number, labels in found:
        tile = tiling.tiles[number]
        with stages.timed("look up"):
            stitcher.add(tiling.core(tile), labels)
        num_seen += labels.num_seen
        distances[number] = labels.neighbor_distance
        progress.advance(tile.num_points)
        give_back()
    sizes = [tile.num_points for tile in tiling.tiles]
    return VoxelLabels(stitcher, num_seen, _weighted_median(distances, sizes))


@dataclass(frozen=True, slots=True)
class _Labelling:
    """The tiles of a scan, each labelled once; see :func:`label_voxels`."""

    model: Model
    scan: VoxelScan
    tiling: Tiling
    config: PredictConfig
    place: Path
    stages: Stages

    def here(self) -> Iterator[tuple[int, TileLabels]]:
        """Labels of each tile, by this process."""
        is_kept = len(self.tiling.tiles) > 1
        for number, tile in enumerate(self.tiling.tiles):
            labels = self._finished(number) if is_kept else None
            if labels is None:
                predicted = label_tile(
                    self.model, self.scan, self.tiling, tile, self.config, self.stages
                )
                labels = TileLabels.of(predicted, self.model.card.scheme.bush_index)
                if is_kept:
                    with self.stages.timed("keep tiles"):
                        labels.save(tile_path(self.place, number))
            yield number, labels

    def elsewhere(self, scheduler: Scheduler) -> Iterator[tuple[int, TileLabels]]:
        """Labels of each tile, by other processes, as they end."""
        missing = []
        for number in range(len(self.tiling.tiles)):
            labels = self._finished(number)
            if labels is None:
                missing.append(number)
                tile_path(self.place, number).unlink(missing_ok=True)  # if it is damaged
            else:
                yield number, labels
        if not missing:
            return
        path = self.place / _MODEL
        save_model(path, self.model.card, self.model.network)
        shared = {
            "folder": str(self.place.absolute()),
            "model_path": str(path.absolute()),
            "model_hash": file_hash(path),
            "settings": self.config.model_dump(mode="json", include={"precision", "max_memory"}),
        }
        jobs = {number: shared | {"number": number} for number in missing}
        deaths: dict[int, str] = {}
        with self.stages.timed("workers"):
            for number, outcome in run_twice(scheduler, LABEL_TILE, jobs):
                if outcome.error is not None:
                    raise WorkerError(outcome.error)
                if outcome.death is not None:
                    deaths[number] = outcome.death
                else:
                    wait_until_seen(tile_path(self.place, number))
                    yield number, self._read(number)
        if deaths:
            raise WorkerError(_obituary(self.scan, self.tiling, deaths))

    def _finished(self, number: int) -> TileLabels | None:
        """A tile's labels, if an earlier run left them."""
        if not tile_path(self.place, number).exists():
            return None
        try:
            return self._read(number)
        except CacheError:  # damaged: it is done again
            return None

    def _read(self, number: int) -> TileLabels:
        scheme = self.model.card.scheme
        return TileLabels.load(
            tile_path(self.place, number),
            self.tiling.tiles[number].num_points,
            scheme.num_classes,
            has_bush=scheme.bush_index is not None,
        )


def _obituary(scan: VoxelScan, tiling: Tiling, deaths: dict[int, str]) -> str:
    """Which tiles killed those who labelled them."""
    number, death = min(deaths.items())
    others = f", and so were {len(deaths) - 1} others'" if len(deaths) > 1 else ""
    num_done = len(tiling.tiles) - len(deaths)
    return (
        f"tile {number} ({_place(scan, tiling.tiles[number])}): its worker was lost twice "
        f"({death}){others}; {num_done} of {len(tiling.tiles)} tiles are done and kept: make "
        "memory free, then start the same command again"
    )


def _place(scan: VoxelScan, tile: Tile) -> str:
    """Where a tile lies, in the scan's coordinates."""
    grid = scan.voxels.grid
    (x0, y0), (x1, y1) = (
        grid.origin[:2] + np.array(corner) * BLOCK * grid.voxel_size
        for corner in (tile.low, tile.high)
    )
    return f"x {x0:.1f} to {x1:.1f}, y {y0:.1f} to {y1:.1f}, {tile.num_points:,} voxels"


def _weighted_median(values: NDArray[np.float64], weights: list[int]) -> float:
    """Median of values that stand for so many points each."""
    order = np.argsort(values)
    running = np.cumsum(np.array(weights)[order])
    return float(values[order[int(np.searchsorted(running, running[-1] / 2))]])
