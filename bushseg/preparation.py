"""Scans become cached tensors: voxels by tile, and crops drawn ahead of training.

What stands on disk is in :mod:`bushseg.prepared`. A second run finds what is complete and keeps it.
"""

import shutil
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.cache import FORMAT_VERSION, KEY_DIGITS, write_json
from bushseg.codes import Encoded, UnknownCodes
from bushseg.config import PrepareConfig
from bushseg.crop_files import finished_crops, write_crops
from bushseg.errors import ConfigError, DataError
from bushseg.features import FEATURES
from bushseg.files import remove_partials
from bushseg.io import find_scans
from bushseg.labels import load_scheme
from bushseg.locks import locked
from bushseg.memory import be_lean, fit_table
from bushseg.prepared import DATASET, SCANS, SCRATCH, crops_key, lock_name, scan_key
from bushseg.progress import SILENT, Progress
from bushseg.scan_tiles import finished_tiles
from bushseg.scheme import ClassScheme
from bushseg.stages import Stages
from bushseg.subsample import MAX_VOXELS
from bushseg.tile_making import Makers, make_tiles

_KEY = "-" + "[0-9a-f]" * KEY_DIGITS
_NO_LABELS = np.empty(0, dtype=np.int16)


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
        features: Features that any scan has.
        seconds: From the first scan to the finished data set.
        stages: Seconds by stage: read, sub-sample, ground and features, tiling, neighbors,
            normals, write (tiles), draw crops (with their indices, and written); none where
            nothing had to be done, of tiles none where other processes made them.
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
    seconds: float
    stages: dict[str, float]
    warnings: tuple[str, ...]


def prepare(
    paths: Iterable[str | Path],
    output: str | Path = "prepared",
    config: PrepareConfig | None = None,
    *,
    max_memory: int | str | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    insecure_scheduler: bool = False,
    progress: Progress = SILENT,
) -> PrepareResult:
    """Prepare scans for training.

    What an earlier run made with the same settings from the same files is kept; tiles of scans that
    are no longer named, and crops of other settings, are removed.

    Args:
        paths: Scans, or folders that are searched for them.
        output: The data set's folder.
        config: Settings; None takes the defaults.
        max_memory: Memory to keep within, bytes or a size such as "2GB": what of a scan goes beyond
            it stands in files beside its tiles meanwhile, which come out the same. Each of several
            processes has its share; each of a Dask cluster's may take all of it.
        workers: Processes that make scans into tiles at once; 1 is this one, on all cores.
        scheduler: Dask scheduler whose workers do so, tcp://... or tls://...; they must see scans
            and output by the same paths.
        insecure_scheduler: Whether a scheduler of another machine may be called without tls.
        progress: Told of points read, tiles made and crops drawn; of scans, where other processes
            make the tiles.

    Returns:
        What was done.

    Raises:
        BushsegError: A scan can't be read, a setting doesn't fit, there is no scan at all, the disk
            is full, `max_memory` is too little, another process prepares into this folder, or one
            of several was lost twice by a scan: the others are finished and kept.
    """
    if workers < 1:
        raise ConfigError(f"workers is {workers}; expected 1 or more")
    if scheduler is not None and workers > 1:
        raise ConfigError("workers and scheduler are both set; name one of them")
    config = config or PrepareConfig()
    scheme = load_scheme(config.scheme)
    max_voxels = each = MAX_VOXELS
    if max_memory is not None:
        be_lean()
        max_voxels = fit_table(max_memory, config.tile_points, scheme.num_classes)
        each = fit_table(max_memory, config.tile_points, scheme.num_classes, workers)
    makers = Makers(each, max_memory is not None, workers, scheduler, insecure_scheduler)
    scans = find_scans(paths)
    if not scans:
        raise DataError(f"{', '.join(map(str, paths))}: no scan found; give scans or their folder")
    with locked(output):
        return _prepare(scans, Path(output), config, scheme, max_voxels, makers, progress)


def _prepare(
    scans: Sequence[Path],
    folder: Path,
    config: PrepareConfig,
    scheme: ClassScheme,
    max_voxels: int,
    makers: Makers,
    progress: Progress,
) -> PrepareResult:
    """Make what isn't there, in a folder that nobody else writes to."""
    begun, stages = time.perf_counter(), Stages()
    remove_partials(folder / DATASET)
    places = [_place(folder, path, config, scheme) for path in scans]
    _remove_abandoned(folder, places)
    kept = [finished_tiles(place) for place in places]
    whole = zip(scans, places, kept, strict=True)
    due = {path: place for path, place, manifest in whole if manifest is None}
    made = make_tiles(due, folder, config, scheme, makers, progress, stages)
    manifests = [
        {**(manifest or made[path]), "folder": f"{SCANS}/{place.name}"}
        for path, place, manifest in zip(scans, places, kept, strict=True)
    ]
    crops = folder / f"crops-{crops_key(manifests, config)}"
    tiles = [tile for manifest in manifests for tile in manifest["tiles"]]
    class_counts = np.sum([tile["class_counts"] for tile in tiles], axis=0)
    drawn = finished_crops(crops)
    crops_redone = drawn is None
    if drawn is None:
        drawn = write_crops(
            folder, crops, manifests, class_counts, config, max_voxels, progress, stages
        )
    features = [manifest["features"] for manifest in manifests]
    dataset = {
        "version": FORMAT_VERSION,
        "config": config.model_dump(mode="json"),
        "scheme": scheme.model_dump(mode="json"),
        "scans": manifests,
        "crops": crops.name,
        "class_counts": class_counts.tolist(),
        "features": [name for name in FEATURES if any(name in have for have in features)],
    }
    write_json(folder / DATASET, dataset)
    _remove_stale(folder, [manifest["folder"] for manifest in manifests], crops.name)
    return PrepareResult(
        folder=folder,
        num_scans=len(scans),
        num_redone=len(due),
        num_tiles=len(tiles),
        num_crops=len(drawn["tiles"]),
        crops_redone=crops_redone,
        num_points=sum(manifest["num_points"] for manifest in manifests),
        num_voxels=sum(tile["core_size"] for tile in tiles),
        class_counts=dict(zip(scheme.names, class_counts.tolist(), strict=True)),
        features=tuple(dataset["features"]),
        seconds=time.perf_counter() - begun,
        stages=stages.seconds,
        warnings=tuple(_warnings(manifests, scheme)),
    )


def _place(folder: Path, scan: Path, config: PrepareConfig, scheme: ClassScheme) -> Path:
    """A scan's folder in the data set."""
    return folder / SCANS / f"{scan.name.split('.')[0][:60]}-{scan_key(scan, config, scheme)}"


def _remove_abandoned(folder: Path, places: Sequence[Path]) -> None:
    """Remove what killed runs with other settings kept to go on with: it may be large."""
    for path in _keyed(folder):
        if path not in places:
            shutil.rmtree(path / SCRATCH, ignore_errors=True)


def _warnings(manifests: Sequence[dict[str, Any]], scheme: ClassScheme) -> Iterable[str]:
    """One line for each thing a user should know."""
    unknown = UnknownCodes()
    for manifest in manifests:
        codes = {int(code): count for code, count in manifest["unknown_codes"].items()}
        unknown.add(Encoded(_NO_LABELS, codes, manifest["invalid_codes"]))
    if unknown.num_points:
        yield (
            f"{unknown.num_points:,} points have codes that scheme {scheme.name!r} doesn't know "
            f"and are taken as unlabelled: {unknown}"
        )
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
    for path in _keyed(folder):
        if path not in keep:
            shutil.rmtree(path)
    for path in folder.glob(f"{SCANS}/{lock_name('*' + _KEY)}"):  # of killed processes
        path.unlink(missing_ok=True)


def _keyed(folder: Path) -> list[Path]:
    """The folders of scans and crops, of any key."""
    found = (*folder.glob(f"{SCANS}/*{_KEY}"), *folder.glob(f"crops{_KEY}"))
    return [path for path in found if path.is_dir()]
