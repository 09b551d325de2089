"""One scan's part of a prepared data set: its tiles, as files, from the file alone.

Voxels that memory can't hold stand in a hidden folder beside the tiles until these are done, as
:mod:`bushseg.stored_scan` keeps them, with a record of each tile that is written: a run that was
killed is gone on with. A scan that fits memory is done again instead.
"""

import shutil
from contextlib import suppress
from dataclasses import dataclass
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
        work = _Work(
            path, place, config, scheme, max_voxels, progress, stages or Stages(), name or str(path)
        )
        return finished_tiles(place) or work.write()


@dataclass(frozen=True, slots=True)
class _Work:
    """What :func:`write_tiles` was given, in a folder that nobody else writes to."""

    path: Path
    place: Path
    config: PrepareConfig
    scheme: ClassScheme
    max_voxels: int
    progress: Progress
    stages: Stages
    name: str

    def write(self) -> dict[str, Any]:
        """Write the tiles and their manifest."""
        scan, tiling = self._voxels()
        normals, distances = voxel_normals(scan, tiling, self.config.num_neighbors, self.stages)
        give_back()
        self.progress.start(f"tiling {self.path.name}", len(tiling.tiles), "tiles")
        entries = []
        for number in range(len(tiling.tiles)):
            entries.append(self._write_tile(number, scan, tiling, normals, distances))
            self.progress.advance(1)
        manifest = {
            "version": FORMAT_VERSION,
            "path": self.name,
            "num_points": scan.num_points,
            "num_skipped": scan.num_skipped,
            "unknown_codes": {str(code): count for code, count in scan.unknown.codes.items()},
            "invalid_codes": scan.unknown.invalid,
            "tiles": entries,
            "has_labels": scan.voxels.labels is not None,
            "features": list(scan.features),
            "oriented_to": "sensor" if scan.sensor is not None else "up",
        }
        write_json(self.place / MANIFEST, manifest)
        shutil.rmtree(self.place / SCRATCH, ignore_errors=True)
        return manifest

    def _voxels(self) -> tuple[VoxelScan, Tiling]:
        """The scan's voxels and tiles: those that an earlier run left, or new ones."""
        scratch = self.place / SCRATCH
        with suppress(CacheError):
            stored = open_stored(scratch)
            remove_partials_in(self.place)
            return stored
        shutil.rmtree(self.place, ignore_errors=True)  # what a killed run left
        with open_scan(self.path) as reader:
            scan = read_voxels(
                reader,
                self.config.voxel_size,
                self.scheme,
                self.config.label_field,
                self.progress,
                self.stages,
                folder=scratch,
                max_voxels=self.max_voxels,
            )
        voxels = scan.voxels
        with self.stages.timed("tiling"):
            tiling = Tiling(voxels.keys, self.config.tile_points, self.config.halo, voxels.scratch)
        if voxels.scratch.folder is not None:
            with self.stages.timed("write"):
                store_scan(scan, tiling)
        return scan, tiling

    def _write_tile(
        self,
        number: int,
        scan: VoxelScan,
        tiling: Tiling,
        normals: NDArray[np.float32],
        distances: NDArray[np.float32],
    ) -> dict[str, Any]:
        """Write a tile, unless an earlier run has; what the manifest says of it."""
        place = self.place / tile_name(number)
        record = self.place / SCRATCH / f"{tile_name(number)}.json"
        is_kept = scan.voxels.scratch.folder is not None
        if is_kept and (entry := _finished(place, record)) is not None:
            return entry
        with self.stages.timed("tiling"):
            data = cut_points(scan, tiling, tiling.tiles[number], normals)
        with self.stages.timed("write"):
            save_tile(place, data)
        entry = _entry(data, distances, self.scheme.num_classes)
        if is_kept:
            with self.stages.timed("write"):
                write_json(record, {"version": FORMAT_VERSION, **entry})
        return entry


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
