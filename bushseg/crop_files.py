"""A prepared data set's crops: drawn over all tiles, written with the indices of all levels."""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.cache import (
    FORMAT_VERSION,
    load_tensors,
    pyramid_from_tensors,
    pyramid_tensors,
    read_finished,
    save_tensors,
    write_json,
)
from bushseg.config import PrepareConfig
from bushseg.crops import Crop, CropSampler, class_weights, enough_crops
from bushseg.errors import CacheError
from bushseg.files import remove_partials_in
from bushseg.manifests import CropsManifest
from bushseg.parallel import map_ahead
from bushseg.prepared import MANIFEST, SCRATCH, crop_name, tile_name
from bushseg.progress import Progress
from bushseg.scratch import Scratch
from bushseg.stages import Stages
from bushseg.tile_data import CropSource
from bushseg.tile_files import load_crop_source

_ZETA_VOXELS = 8
"""Voxels whose zeta, and no more, memory holds where it may hold one in a scan's table."""


def finished_crops(crops: Path) -> dict[str, Any] | None:
    """The manifest of a data set's crops if they are all there; None where something is missing.

    Args:
        crops: The crops' folder.
    """
    manifest = read_finished(crops / MANIFEST, crop_name, CropsManifest)
    if manifest is not None:
        shutil.rmtree(crops / SCRATCH, ignore_errors=True)  # killed before it had tidied up
    return manifest


def write_crops(
    folder: Path,
    crops: Path,
    manifests: Sequence[dict[str, Any]],
    class_counts: NDArray[np.int64],
    config: PrepareConfig,
    max_voxels: int,
    progress: Progress,
    stages: Stages,
) -> dict[str, Any]:
    """Draw crops over all tiles by MRS and write them with the indices of all levels.

    Those that a killed run wrote are drawn again, since those to come follow from them, but their
    indices of all levels, which take most of the time, are kept.

    Args:
        folder: The data set.
        crops: The crops' folder in it.
        manifests: What is known of each scan, and its "folder".
        class_counts: Labelled voxels per class, shape (C,).
        config: Settings.
        max_voxels: Voxels that memory may hold while a scan is read.
        progress: Told of the crops drawn.
        stages: Told of the time that takes.

    Returns:
        The crops' manifest, written last.

    Raises:
        CacheError: A tile is damaged.
        WriteError: The disk refuses.
    """
    files = [
        folder / manifest["folder"] / tile_name(number)
        for manifest in manifests
        for number in range(len(manifest["tiles"]))
    ]
    core_sizes = [tile["core_size"] for manifest in manifests for tile in manifest["tiles"]]
    num_crops = config.num_crops or enough_crops(sum(core_sizes), config.crop_points)
    remove_partials_in(crops)
    shutil.rmtree(crops / SCRATCH, ignore_errors=True)
    on_disk = sum(core_sizes) > _ZETA_VOXELS * max_voxels
    sampler = CropSampler(
        core_sizes,
        lambda number: load_crop_source(files[number]),
        config.crop_points,
        class_weights(class_counts),
        np.random.default_rng(config.seed),
        Scratch(crops / SCRATCH if on_disk else None),
    )

    def draws() -> Iterator[tuple[int, Crop, CropSource]]:
        for number, crop in enumerate(sampler.draws(num_crops)):
            yield number, crop, sampler.points(crop.tile).take(crop.indices)

    def write(draw: tuple[int, Crop, CropSource]) -> tuple[int, bool]:
        number, crop, points = draw
        path = crops / crop_name(number)
        if not _is_written(path, crop.indices):
            pyramid = points.pyramid(config)
            save_tensors(path, {"indices": crop.indices, **pyramid_tensors(pyramid)})
        return crop.tile, bool((points.labels >= 0).any())

    progress.start("drawing crops", num_crops, "crops")
    tiles, labelled = [], []
    for tile_number, has_labels in stages.each("draw crops", map_ahead(write, draws())):
        tiles.append(tile_number)
        labelled.append(has_labels)
        progress.advance(1)
    manifest = {
        "version": FORMAT_VERSION,
        "num_crops": num_crops,
        "tiles": tiles,
        "labelled": labelled,
    }
    write_json(crops / MANIFEST, manifest)
    shutil.rmtree(crops / SCRATCH, ignore_errors=True)
    return manifest


def _is_written(path: Path, indices: NDArray[np.int32]) -> bool:
    """Whether a file holds the crop of these points."""
    if not path.exists():
        return False
    try:
        tensors = load_tensors(path)
        found = tensors.pop("indices", None)
        pyramid_from_tensors(tensors, len(indices))
    except CacheError:
        return False
    return found is not None and np.array_equal(found, indices)
