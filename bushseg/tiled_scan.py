"""A scan's voxels, cut into tiles: those that an earlier run left, or new ones."""

from contextlib import suppress
from pathlib import Path

from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.errors import CacheError
from bushseg.io.kept import KeptReader
from bushseg.labeler import cut
from bushseg.memory import fit
from bushseg.progress import Progress
from bushseg.scan import VoxelScan, read_voxels
from bushseg.stages import Stages
from bushseg.stored_scan import MANIFEST, open_stored, store_scan
from bushseg.subsample import MAX_VOXELS
from bushseg.tiling import Tiling


def tile_scan(
    kept: KeptReader,
    model: Model,
    config: PredictConfig,
    place: Path,
    progress: Progress,
    stages: Stages,
    *,
    on_disk: bool,
) -> tuple[VoxelScan, Tiling]:
    """Take up a scan's voxels and tiles, or make them.

    Voxels that memory can hold are read again instead of taken up: that takes less time than a
    tile.

    Args:
        kept: The scan.
        model: Says how large voxels are, and halos.
        config: Tile size, halo and the memory to keep within.
        place: Where an earlier run left them, and where they go if memory can't hold them.
        progress: Told of the points read.
        stages: Told of the time that each step takes.
        on_disk: Whether they go there however few they are, for other processes to find them.

    Raises:
        DataError: There are no finite points.
        ReadError: The scan is damaged.
        WriteError: The disk refuses.
    """
    with suppress(CacheError):
        stored = open_stored(place)
        kept.forget_head()
        return stored
    (place / MANIFEST).unlink(missing_ok=True)  # what it says isn't true of new arrays
    scan = read_voxels(
        kept,
        model.card.prepare.voxel_size,
        progress=progress,
        stages=stages,
        folder=place,
        max_voxels=MAX_VOXELS if config.max_memory is None else fit(config.max_memory).max_voxels,
        on_disk=on_disk,
    )
    with stages.timed("tiling"):
        tiling = cut(model, scan, config)
        if scan.voxels.scratch.folder is not None:
            store_scan(scan, tiling)
    return scan, tiling
