"""One scan's part of a prepared data set: its tiles, as files, from the file alone.

Voxels that memory can't hold stand in a hidden folder beside the tiles until these are done, as
:mod:`bushseg.stored_scan` keeps them, with a record of each tile that is written: a run that was
killed is gone on with. A scan that fits memory is done again instead.
"""

import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.cache import FORMAT_VERSION, read_finished, read_json, write_json
from bushseg.config import PrepareConfig
from bushseg.errors import CacheError
from bushseg.features import height_profile
from bushseg.files import remove_partials_in
from bushseg.io import open_scan
from bushseg.locks import locked
from bushseg.manifests import ScanManifest, TileRecord, check_manifest
from bushseg.memory import give_back
from bushseg.prepared import MANIFEST, SCRATCH, lock_name, tile_name
from bushseg.progress import SILENT, Progress
from bushseg.scan import VoxelScan, read_voxels
from bushseg.scheme import ClassScheme
from bushseg.stages import Stages
from bushseg.stored_scan import open_stored, store_scan
from bushseg.subsample import MAX_VOXELS
from bushseg.tile_data import TileData, cut_points
from bushseg.tile_files import load_tile, save_tile
from bushseg.tiling import Tiling
from bushseg.voxel_normals import voxel_normals

_PATIENCE = 30.0
"""Seconds for a worker process to notice that whoever gave it its work was killed, and end."""


def finished_tiles(place: Path) -> dict[str, Any] | None:
    """The manifest of a scan's tiles if they are all there; None where something is missing.

    Args:
        place: The scan's folder in the data set.
    """
    manifest = read_finished(place / MANIFEST, tile_name, ScanManifest)
    if manifest is not None:
        shutil.rmtree(place / SCRATCH, ignore_errors=True)  # killed before it had tidied up
    return manifest


def write_tiles(
    path: Path,
    place: Path,
    config: PrepareConfig,
    scheme: ClassScheme,
    max_voxels: int = MAX_VOXELS,
    progress: Progress = SILENT,
    stages: Stages | None = None,
    name: str | None = None,
) -> dict[str, Any]:
    """Read one scan and write its tiles; the manifest, written last, says that all are there.

    If they are already, nothing is done.

    Args:
        path: The scan.
        place: Its folder in the data set, named by all that the tiles follow from; what a killed
            run left there is taken up.
        config: Settings.
        scheme: The classes.
        max_voxels: Voxels to hold in memory.
        progress: Told of points read and tiles made.
        stages: Told of the time that each step takes.
        name: What the manifest calls the scan; None: by its path.

    Returns:
        The manifest.

    Raises:
        BushsegError: The scan can't be read, the disk refuses, or another process is at it and
            doesn't end soon: a cluster's may go on though whoever gave it its work was killed.
    """
    with locked(place.parent, lock_name(place.name), _PATIENCE):
        return finished_tiles(place) or _write_tiles(
            path, place, config, scheme, max_voxels, progress, stages or Stages(), name or str(path)
        )


def _write_tiles(
    path: Path,
    place: Path,
    config: PrepareConfig,
    scheme: ClassScheme,
    max_voxels: int,
    progress: Progress,
    stages: Stages,
    name: str,
) -> dict[str, Any]:
    """As :func:`write_tiles`, in a folder that nobody else writes to."""
    scratch = place / SCRATCH
    scan, tiling = _voxels(path, place, config, scheme, max_voxels, progress, stages)
    normals, distances = voxel_normals(scan, tiling, config.num_neighbors, stages)
    give_back()
    progress.start(f"tiling {path.name}", len(tiling.tiles), "tiles")
    entries = []
    for number, tile in enumerate(tiling.tiles):
        record = scratch / f"{tile_name(number)}.json"
        is_kept = scan.voxels.scratch.folder is not None
        entry = _finished(place / tile_name(number), record) if is_kept else None
        if entry is None:
            with stages.timed("tiling"):
                data = cut_points(scan, tiling, tile, normals)
            with stages.timed("write"):
                save_tile(place / tile_name(number), data)
            entry = _entry(data, distances, scheme.num_classes)
            if is_kept:
                with stages.timed("write"):
                    write_json(record, {"version": FORMAT_VERSION, **entry})
        entries.append(entry)
        progress.advance(1)
    manifest = {
        "version": FORMAT_VERSION,
        "path": name,
        "num_points": scan.num_points,
        "num_skipped": scan.num_skipped,
        "unknown_codes": {str(code): count for code, count in scan.unknown.codes.items()},
        "invalid_codes": scan.unknown.invalid,
        "tiles": entries,
        "has_labels": scan.voxels.labels is not None,
        "features": list(scan.features),
        "oriented_to": "sensor" if scan.sensor is not None else "up",
    }
    write_json(place / MANIFEST, manifest)
    shutil.rmtree(scratch, ignore_errors=True)
    return manifest


def _voxels(
    path: Path,
    place: Path,
    config: PrepareConfig,
    scheme: ClassScheme,
    max_voxels: int,
    progress: Progress,
    stages: Stages,
) -> tuple[VoxelScan, Tiling]:
    """A scan's voxels and tiles: those that an earlier run left, or new ones."""
    scratch = place / SCRATCH
    with suppress(CacheError):
        stored = open_stored(scratch)
        remove_partials_in(place)
        return stored
    shutil.rmtree(place, ignore_errors=True)  # what a killed run left
    with open_scan(path) as reader:
        scan = read_voxels(
            reader,
            config.voxel_size,
            scheme,
            config.label_field,
            progress,
            stages,
            folder=scratch,
            max_voxels=max_voxels,
        )
    with stages.timed("tiling"):
        tiling = Tiling(scan.voxels.keys, config.tile_points, config.halo, scan.voxels.scratch)
    if scan.voxels.scratch.folder is not None:
        with stages.timed("write"):
            store_scan(scan, tiling)
    return scan, tiling


def _entry(data: TileData, distances: NDArray[np.float32], num_classes: int) -> dict[str, Any]:
    """What the manifest says of a tile."""
    labels = data.labels[data.labels >= 0]
    return {
        "core_size": int(np.count_nonzero(data.is_core)),
        "class_counts": np.bincount(labels, minlength=num_classes).tolist(),
        "neighbor_distance": float(np.median(distances[data.indices])),
        "height_profile": list(height_profile(data.features["height"][data.is_core])),
    }


def _finished(tile: Path, record: Path) -> dict[str, Any] | None:
    """What the manifest says of a tile that an earlier run wrote; None if it isn't all there."""
    try:
        entry = read_json(record)
        check_manifest(TileRecord, entry, record)
        load_tile(tile)
    except CacheError:
        return None
    del entry["version"]
    return entry
