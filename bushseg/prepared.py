"""What stands in a prepared data set's folders, and writing a scan's tiles and the crops.

    prepared/
      dataset.json              settings, scans, classes, features
      scans/NAME-KEY/           manifest.json, tile_0000.safetensors ...
      crops-KEY/                manifest.json, crop_00000.safetensors ...

A folder's KEY is the hash of all its content follows from: the settings, the file's identity,
the format version. A folder is complete when its manifest stands, which is written last.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.cache import (
    FORMAT_VERSION,
    fingerprint,
    identity,
    load_tile,
    pyramid_tensors,
    save_tensors,
    save_tile,
    write_json,
)
from bushseg.config import PrepareConfig
from bushseg.crops import OPEN_TILES, Crop, CropSampler, class_weights, enough_crops
from bushseg.features import height_profile
from bushseg.io import label_sidecar, open_scan
from bushseg.parallel import map_ahead
from bushseg.progress import Progress
from bushseg.scan import read_voxels
from bushseg.scheme import ClassScheme
from bushseg.stages import Stages
from bushseg.tile_data import TileData, cut_points
from bushseg.tiling import Tiling
from bushseg.voxel_normals import voxel_normals

DATASET = "dataset.json"
MANIFEST = "manifest.json"

# Tiles follow from every other setting; of the scheme its content counts, not its name.
CROP_SETTINGS = {"crop_points", "num_crops"}


def tile_name(number: int) -> str:
    """File name of a scan's tile."""
    return f"tile_{number:04d}.safetensors"


def crop_name(number: int) -> str:
    """File name of a data set's crop."""
    return f"crop_{number:05d}.safetensors"


def scan_key(path: Path, config: PrepareConfig, scheme: ClassScheme) -> str:
    """Hash of all that a scan's tiles follow from."""
    settings = config.model_dump(mode="json", exclude=CROP_SETTINGS | {"scheme"})
    sidecar = label_sidecar(path)
    files = [identity(file) for file in (path, sidecar) if file is not None]
    return fingerprint(
        {"settings": settings, "scheme": scheme.model_dump(mode="json"), "files": files}
    )


def crops_key(manifests: Sequence[dict[str, Any]], config: PrepareConfig) -> str:
    """Hash of all that a data set's crops follow from."""
    return fingerprint(
        {
            "scans": [manifest["folder"] for manifest in manifests],
            **config.model_dump(mode="json", include=CROP_SETTINGS),
        }
    )


def write_tiles(
    path: Path,
    tiles: Path,
    config: PrepareConfig,
    scheme: ClassScheme,
    progress: Progress,
    stages: Stages,
) -> dict[str, Any]:
    """Read one scan and write its tiles; the manifest, written last, says that all are there."""
    with open_scan(path) as reader:
        scan = read_voxels(reader, config.voxel_size, scheme, config.label_field, progress, stages)
    normals, distances = voxel_normals(scan, config.num_neighbors, stages)
    with stages.timed("tiling"):
        tiling = Tiling(scan.voxels.keys, config.tile_points, config.halo, scan.voxels.scratch)
    progress.start(f"tiling {path.name}", len(tiling.tiles), "tiles")
    entries = []
    for number, tile in enumerate(tiling.tiles):
        with stages.timed("tiling"):
            data = cut_points(scan, tiling, tile, normals)
        with stages.timed("write"):
            save_tile(tiles / tile_name(number), data)
        labels = data.labels[data.labels >= 0]
        entries.append(
            {
                "core_size": tile.num_points,
                "class_counts": np.bincount(labels, minlength=scheme.num_classes).tolist(),
                "neighbor_distance": float(np.median(distances[data.indices])),
                "height_profile": height_profile(data.features["height"][data.is_core]),
            }
        )
        progress.advance(1)
    manifest = {
        "version": FORMAT_VERSION,
        "path": str(path),
        "num_points": scan.num_points,
        "num_skipped": scan.num_skipped,
        "unknown_codes": {str(code): count for code, count in scan.unknown.codes.items()},
        "invalid_codes": scan.unknown.invalid,
        "tiles": entries,
        "has_labels": scan.voxels.labels is not None,
        "features": list(scan.features),
        "oriented_to": "sensor" if scan.sensor is not None else "up",
    }
    write_json(tiles / MANIFEST, manifest)
    return manifest


def write_crops(
    folder: Path,
    crops: Path,
    manifests: Sequence[dict[str, Any]],
    class_counts: NDArray[np.int64],
    config: PrepareConfig,
    progress: Progress,
    stages: Stages,
) -> dict[str, Any]:
    """Draw crops over all tiles by MRS and write them with the indices of all levels."""
    files = [
        folder / manifest["folder"] / tile_name(number)
        for manifest in manifests
        for number in range(len(manifest["tiles"]))
    ]
    core_sizes = [tile["core_size"] for manifest in manifests for tile in manifest["tiles"]]
    num_crops = config.num_crops or enough_crops(sum(core_sizes), config.crop_points)

    @lru_cache(OPEN_TILES)
    def load(number: int) -> TileData:
        # Shared by the sampler and the loop below, which want the same tile one after the other.
        return load_tile(files[number])

    sampler = CropSampler(
        core_sizes,
        load,
        config.crop_points,
        class_weights(class_counts),
        np.random.default_rng(config.seed),
    )

    def draws() -> Iterator[tuple[int, TileData, Crop]]:
        for number, crop in enumerate(sampler.draws(num_crops)):
            yield number, load(crop.tile), crop

    def write(draw: tuple[int, TileData, Crop]) -> tuple[int, bool]:
        number, tile, crop = draw
        pyramid = tile.crop_pyramid(crop.indices, config)
        tensors = {"indices": crop.indices, **pyramid_tensors(pyramid)}
        save_tensors(crops / crop_name(number), tensors)
        return crop.tile, bool((tile.labels[crop.indices] >= 0).any())

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
    return manifest
