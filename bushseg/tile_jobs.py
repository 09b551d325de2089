"""One tile as a job of another process: from files to a file, with nothing but paths in between."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from bushseg.bundled import file_hash
from bushseg.checkpoint import Model, load_model
from bushseg.config import PredictConfig
from bushseg.errors import CacheError, CheckpointError
from bushseg.labeler import label_tile
from bushseg.memory import be_lean, give_back
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.stored_scan import MANIFEST, open_stored
from bushseg.tile_labels import TileLabels, tile_path
from bushseg.tiling import Tiling


def label_tile_job(
    folder: str, number: int, model_path: str, model_hash: str, settings: Mapping[str, Any]
) -> None:
    """Label one tile of a stored scan and keep its labels beside it.

    The scan and the model stay open for the next job of the same process.

    Args:
        folder: Where :func:`bushseg.stored_scan.store_scan` left the scan.
        number: Which of its tiles.
        model_path: The model's file.
        model_hash: SHA-256 of that file.
        settings: What of :class:`PredictConfig` isn't as by default.

    Raises:
        CacheError: There is no such scan or tile, or it is damaged.
        CheckpointError: The model's file is missing, damaged or another one.
        WriteError: The labels can't be written.
    """
    config = PredictConfig.from_dict(dict(settings), "job")
    if config.max_memory is not None:
        be_lean()
    model = _model(model_path, model_hash)
    manifest = Path(folder) / MANIFEST
    try:
        stamp = manifest.stat().st_mtime_ns
    except OSError as error:
        raise CacheError(f"{manifest}: can't be read ({error.strerror or error})") from error
    scan, tiling = _stored(folder, stamp)
    if not 0 <= number < len(tiling.tiles):
        raise CacheError(f"{folder}: has {len(tiling.tiles)} tiles, none of number {number}")
    tile = tiling.tiles[number]
    predicted = label_tile(model, scan, tiling, tile, config, Stages())
    labels = TileLabels.of(predicted, model.card.scheme.bush_index)
    labels.save(tile_path(Path(folder), number))
    give_back()


def forget() -> None:
    """Close the scan and the model that are open."""
    _stored.cache_clear()
    _model.cache_clear()


@lru_cache(maxsize=1)
def _stored(folder: str, _stamp: int) -> tuple[VoxelScan, Tiling]:
    """A stored scan; another one if its manifest was written anew."""
    return open_stored(Path(folder))


@lru_cache(maxsize=1)
def _model(path: str, digest: str) -> Model:
    """A model, checked to be the one that is meant."""
    check_model_file(path, digest)
    return load_model(path)


def check_model_file(path: str, digest: str) -> None:
    """Make sure that a model's file is the one that a job means.

    Args:
        path: The file.
        digest: Its SHA-256.

    Raises:
        CheckpointError: It can't be read, or is another.
    """
    try:
        found = file_hash(Path(path))
    except OSError as error:
        raise CheckpointError(f"{path}: can't be read ({error.strerror or error})") from error
    if found != digest:
        raise CheckpointError(
            f"{path}: has SHA-256 {found[:12]}..., the job means {digest[:12]}...; the file was "
            "changed meanwhile: start the command again"
        )
