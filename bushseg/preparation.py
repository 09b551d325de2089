"""Scans become cached tensors: voxels by tile, and crops drawn ahead of training.

    prepared/
      dataset.json              settings, scans, classes, features
      scans/NAME-KEY/           manifest.json, tile_0000.safetensors ...
      crops-KEY/                manifest.json, crop_00000.safetensors ...

A folder's KEY is the hash of all its content follows from: the settings, the file's identity,
the format version. A folder is complete when its manifest stands, which is written last; a second
run finds it and does nothing.
"""

import shutil
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.cache import (
    FORMAT_VERSION,
    KEY_DIGITS,
    fingerprint,
    identity,
    load_tile,
    pyramid_tensors,
    read_finished,
    save_tensors,
    save_tile,
    write_json,
)
from bushseg.config import PrepareConfig
from bushseg.crops import CropSampler, class_weights, enough_crops
from bushseg.errors import DataError
from bushseg.features import FEATURES
from bushseg.io import find_scans, label_sidecar, open_scan
from bushseg.labels import load_scheme
from bushseg.progress import SILENT, Progress
from bushseg.pyramid import build_pyramid
from bushseg.scan import read_voxels
from bushseg.scheme import ClassScheme
from bushseg.tile_data import cut_tile
from bushseg.tiling import Tiling

DATASET = "dataset.json"
MANIFEST = "manifest.json"

# Tiles follow from every other setting; of the scheme its content counts, not its name.
_CROP_SETTINGS = {"crop_points", "num_crops"}


def tile_name(number: int) -> str:
    """File name of a scan's tile."""
    return f"tile_{number:04d}.safetensors"


def crop_name(number: int) -> str:
    """File name of a data set's crop."""
    return f"crop_{number:05d}.safetensors"


@dataclass(frozen=True, slots=True)
class PrepareResult:
    """What a run of prepare did.

    Attributes:
        folder: The data set.
        num_scans: Scans in it.
        num_redone: Scans whose tiles were made in this run.
        num_tiles: Tiles in it.
        num_crops: Crops in it.
        crops_redone: Whether crops were drawn in this run.
        num_points: Raw points of all scans.
        num_voxels: Voxels of all cores.
        class_counts: Labelled voxels by class name.
        features: Features that every scan has.
        warnings: What a user should know: unknown codes, scans without labels, skipped points.
    """

    folder: Path
    num_scans: int
    num_redone: int
    num_tiles: int
    num_crops: int
    crops_redone: bool
    num_points: int
    num_voxels: int
    class_counts: dict[str, int]
    features: tuple[str, ...]
    warnings: tuple[str, ...]


def prepare(
    paths: Iterable[str | Path],
    output: str | Path = "prepared",
    config: PrepareConfig | None = None,
    *,
    progress: Progress = SILENT,
) -> PrepareResult:
    """Prepare scans for training.

    What an earlier run made with the same settings from the same files is kept; tiles of scans that
    are no longer named, and crops of other settings, are removed.

    Args:
        paths: Scans, or folders that are searched for them.
        output: The data set's folder.
        config: Settings; None takes the defaults.
        progress: Told of points read, tiles made and crops drawn.

    Returns:
        What was done.

    Raises:
        BushsegError: A scan can't be read, a setting doesn't fit, or there is no scan at all.
    """
    config = config or PrepareConfig()
    scheme = load_scheme(config.scheme)
    scans = find_scans(paths)
    if not scans:
        raise DataError(f"{', '.join(map(str, paths))}: no scan found; give scans or their folder")
    folder = Path(output)
    manifests, num_redone = [], 0
    for path in scans:
        key = _scan_key(path, config, scheme)
        place = folder / "scans" / f"{path.name.split('.')[0][:60]}-{key}"
        manifest = read_finished(place / MANIFEST, tile_name)
        if manifest is None:
            manifest = _prepare_scan(path, place, config, scheme, progress)
            num_redone += 1
        manifests.append({**manifest, "folder": f"scans/{place.name}"})
    crops_key = fingerprint(
        {
            "scans": [manifest["folder"] for manifest in manifests],
            **config.model_dump(mode="json", include=_CROP_SETTINGS),
        }
    )
    crops = folder / f"crops-{crops_key}"
    tiles = [tile for manifest in manifests for tile in manifest["tiles"]]
    class_counts = np.sum([tile["class_counts"] for tile in tiles], axis=0)
    drawn = read_finished(crops / MANIFEST, crop_name)
    crops_redone = drawn is None
    if drawn is None:
        drawn = _draw_crops(folder, crops, manifests, class_counts, config, progress)
    features = [manifest["features"] for manifest in manifests]
    dataset = {
        "version": FORMAT_VERSION,
        "config": config.model_dump(mode="json"),
        "scheme": scheme.model_dump(mode="json"),
        "scans": manifests,
        "crops": crops.name,
        "class_counts": class_counts.tolist(),
        "features": [name for name in FEATURES if all(name in have for have in features)],
    }
    write_json(folder / DATASET, dataset)
    _remove_stale(folder, [manifest["folder"] for manifest in manifests], crops.name)
    return PrepareResult(
        folder=folder,
        num_scans=len(scans),
        num_redone=num_redone,
        num_tiles=len(tiles),
        num_crops=len(drawn["tiles"]),
        crops_redone=crops_redone,
        num_points=sum(manifest["num_points"] for manifest in manifests),
        num_voxels=sum(tile["core_size"] for tile in tiles),
        class_counts=dict(zip(scheme.names, class_counts.tolist(), strict=True)),
        features=tuple(dataset["features"]),
        warnings=tuple(_warnings(manifests, scheme)),
    )


def _scan_key(path: Path, config: PrepareConfig, scheme: ClassScheme) -> str:
    """Hash of all that a scan's tiles follow from."""
    settings = config.model_dump(mode="json", exclude=_CROP_SETTINGS | {"scheme"})
    sidecar = label_sidecar(path)
    files = [identity(file) for file in (path, sidecar) if file is not None]
    return fingerprint(
        {"settings": settings, "scheme": scheme.model_dump(mode="json"), "files": files}
    )


def _prepare_scan(
    path: Path, tiles: Path, config: PrepareConfig, scheme: ClassScheme, progress: Progress
) -> dict[str, Any]:
    """Read one scan and write its tiles; the manifest, written last, says that all are there."""
    with open_scan(path) as reader:
        scan = read_voxels(reader, config.voxel_size, scheme, config.label_field, progress)
    tiling = Tiling(scan.voxels.keys, config.tile_points, config.halo)
    progress.start(f"tiling {path.name}", len(tiling.tiles), "tiles")
    entries = []
    for number, tile in enumerate(tiling.tiles):
        data = cut_tile(scan, tiling, tile, config)
        save_tile(tiles / tile_name(number), data)
        labels = data.labels[data.labels >= 0]
        entries.append(
            {
                "core_size": tile.num_points,
                "class_counts": np.bincount(labels, minlength=scheme.num_classes).tolist(),
                "neighbor_distance": data.neighbor_distance(),
            }
        )
        progress.advance(1)
    manifest = {
        "version": FORMAT_VERSION,
        "path": str(path),
        "num_points": scan.num_points,
        "num_skipped": scan.num_skipped,
        "unknown_codes": {str(code): count for code, count in scan.unknown_codes.items()},
        "tiles": entries,
        "has_labels": scan.voxels.labels is not None,
        "features": list(scan.features),
        "oriented_to": "sensor" if scan.sensor is not None else "up",
    }
    write_json(tiles / MANIFEST, manifest)
    return manifest


def _draw_crops(
    folder: Path,
    crops: Path,
    manifests: Sequence[dict[str, Any]],
    class_counts: np.ndarray[Any, np.dtype[np.int64]],
    config: PrepareConfig,
    progress: Progress,
) -> dict[str, Any]:
    """Draw crops over all tiles by MRS and write them with the indices of all levels."""
    files = [
        folder / manifest["folder"] / tile_name(number)
        for manifest in manifests
        for number in range(len(manifest["tiles"]))
    ]
    core_sizes = [tile["core_size"] for manifest in manifests for tile in manifest["tiles"]]
    num_crops = config.num_crops or enough_crops(sum(core_sizes), config.crop_points)
    sampler = CropSampler(
        core_sizes,
        lambda number: load_tile(files[number]),
        config.crop_points,
        class_weights(class_counts),
        np.random.default_rng(config.seed),
    )
    progress.start("drawing crops", num_crops, "crops")
    tiles = []
    for number, crop in enumerate(sampler.draws(num_crops)):
        tile = load_tile(files[crop.tile])
        pyramid = build_pyramid(
            tile.xyz[crop.indices],
            tile.keys[crop.indices],
            num_neighbors=config.num_neighbors,
            num_levels=config.num_levels,
            decimation=config.decimation,
            sampling=config.sampling,
            seed=config.seed,
        )
        tensors = {"indices": crop.indices, **pyramid_tensors(pyramid)}
        save_tensors(crops / crop_name(number), tensors)
        tiles.append(crop.tile)
        progress.advance(1)
    manifest = {"version": FORMAT_VERSION, "num_crops": num_crops, "tiles": tiles}
    write_json(crops / MANIFEST, manifest)
    return manifest


def _warnings(manifests: Sequence[dict[str, Any]], scheme: ClassScheme) -> Iterable[str]:
    """One line for each thing a user should know."""
    unknown: Counter[str] = Counter()
    for manifest in manifests:
        unknown.update(manifest["unknown_codes"])
    if unknown:
        codes = ", ".join(f"{code} ({count:,} points)" for code, count in sorted(unknown.items()))
        yield f"label codes that scheme {scheme.name!r} doesn't know, taken as unlabelled: {codes}"
    bare = [manifest["path"] for manifest in manifests if not manifest["has_labels"]]
    if bare:
        yield f"{len(bare)} of {len(manifests)} scans have no labels: {', '.join(bare[:3])}"
    elif not any(any(tile["class_counts"]) for manifest in manifests for tile in manifest["tiles"]):
        yield f"no point has a label that scheme {scheme.name!r} knows: nothing to train on"
    for manifest in manifests:
        if manifest["num_skipped"]:
            count, total = manifest["num_skipped"], manifest["num_points"]
            yield (
                f"{manifest['path']}: {count:,} of {total:,} points left out "
                "(no-returns, not finite or out of the grid's reach)"
            )


def _remove_stale(folder: Path, scans: Sequence[str], crops: str) -> None:
    """Remove what earlier runs made and nothing names any more; what bears no key isn't ours."""
    keep = {folder / name for name in scans} | {folder / crops}
    key = "-" + "[0-9a-f]" * KEY_DIGITS
    for path in (*folder.glob(f"scans/*{key}"), *folder.glob(f"crops{key}")):
        if path.is_dir() and path not in keep:
            shutil.rmtree(path)
