"""A scan in, a labelled scan out.

Two passes over the scan: the first streams it into voxels, which the network labels tile by tile;
the second streams it again, looks every point's voxel up, and writes it with all it had.
"""

import secrets
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import TypeAdapter, ValidationError

from bushseg import io
from bushseg.bundled import file_hash
from bushseg.cache import identity
from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.domain import domain_warnings
from bushseg.errors import CacheError, DataError, WriteError
from bushseg.files import atomic_path, check_output
from bushseg.io.kept import KeptReader
from bushseg.io.memory import MemoryReader
from bushseg.io.sizes import least_bytes
from bushseg.jobs import Scheduler
from bushseg.labeled_scan import LAS_SUFFIXES, write_labeled
from bushseg.labeler import cut, label_tiles
from bushseg.memory import be_lean, fit
from bushseg.model_choice import Candidate, Choice, candidates, choose, suited_better
from bushseg.points import PointCloud
from bushseg.progress import SILENT, Progress
from bushseg.room import check_room
from bushseg.scan import VoxelScan, mask_no_returns, read_voxels
from bushseg.schedulers import opened
from bushseg.stages import Stages
from bushseg.stored_scan import MANIFEST, open_stored, store_scan
from bushseg.subsample import MAX_VOXELS
from bushseg.tiling import Tiling
from bushseg.voxel_labels import label_voxels
from bushseg.waveforms import plan_waveforms
from bushseg.workspace import (
    finished,
    may_be_finished,
    note_finished,
    place_of,
    remove_finished,
    workspace,
)


@dataclass(frozen=True, slots=True)
class PredictResult:
    """What labelling one scan did.

    Attributes:
        input: The scan.
        output: The labelled scan.
        model: Which model was used: its path, or its name where it is a bundled one.
        reason: Why this one, where the scan decided; else empty.
        num_points: Points read and written.
        class_counts: Points per class name.
        num_unlabelled: Points that no voxel holds: not finite, no-returns.
        num_voxels: Voxels they fell into.
        features: Which of the model's features the scan has.
        passes: Voxels that went through the network, per voxel of the scan; 1 is ideal.
        seconds: From opening the scan to the finished output.
        stages: Seconds by stage: choose and load the model, read, sub-sample, ground and
            features, tiling, neighbors, decimation, normals, network, look up, write.
        points_per_second: Points over seconds.
        peak_memory: Largest resident size of this process so far, bytes; None where unknown.
        warnings: Where the scan lies outside what the model was trained on, and classes that the
            output's own label field can't tell apart.
    """

    input: Path
    output: Path
    model: str
    reason: str
    num_points: int
    class_counts: dict[str, int]
    num_unlabelled: int
    num_voxels: int
    features: tuple[str, ...]
    passes: float
    seconds: float
    stages: dict[str, float]
    points_per_second: float
    peak_memory: int | None
    warnings: tuple[str, ...]


_RESULT = TypeAdapter(PredictResult)
_OUTPUT = {"keep_classification", "asprs"}
"""What outputs follow from beside their voxels' labels."""


def predict_file(
    scan: str | Path,
    output: str | Path,
    model: Choice = None,
    config: PredictConfig | None = None,
    *,
    overwrite: bool = False,
    progress: Progress = SILENT,
) -> PredictResult:
    """Label a scan and write it with everything it had.

    The output's suffix decides its format. LAS and LAZ get ASPRS codes as classification, and every
    format that has room for them the columns `class_index` (index into the model's classes, 255 for
    a point without a label), `confidence` and, where the model knows bush, `bush_probability`.

    Args:
        scan: The scan, never touched.
        output: The file to write, whole or not at all.
        model: A model; a bundled model's name, or "default" for whichever of them suits the scan; a
            model file, a run's folder or its name in `runs/`. None takes the newest run's best
            model if there is one, else as "default". What
            :func:`bushseg.model_choice.candidates` found of these is taken as well.
        config: Settings; None takes the defaults.
        overwrite: Whether an existing output may be replaced.
        progress: Told of points read, voxels labelled and points written.

    Returns:
        What was done.

    Raises:
        BushsegError: The scan can't be read, the model doesn't fit, or the output can't be written.
    """
    config = config or PredictConfig()
    with opened(config.workers, config.scheduler, insecure=config.insecure_scheduler) as scheduler:
        return label_file(
            scan, output, model, config, scheduler, overwrite=overwrite, progress=progress
        )


def label_file(
    scan: str | Path,
    output: str | Path,
    model: Choice,
    config: PredictConfig,
    scheduler: Scheduler | None,
    *,
    overwrite: bool = False,
    progress: Progress = SILENT,
) -> PredictResult:
    """As :func:`predict_file`, with a scheduler that is open already.

    A run that was killed when its output stood, before it had tidied up, is told of again.

    Args:
        scan: As there.
        output: As there.
        model: As there.
        config: Settings; of the workers and their scheduler, it only says how many share memory.
        scheduler: Has the tiles labelled by other processes; None labels them here.
        overwrite: As there.
        progress: As there.

    Returns:
        What was done.

    Raises:
        BushsegError: As there.
    """
    if config.max_memory is not None:
        be_lean()
        sizes = fit(config.max_memory, config.workers)
        config = config.model_copy(update={"tile_points": sizes.tile_points})
    scan, output = Path(scan), Path(output)
    inputs = (scan, *filter(None, [io.label_sidecar(scan)]))
    may_stand = may_be_finished(output, config.scratch)
    check_output(output, inputs, overwrite=overwrite or may_stand)
    suffix = io.suffix_of(output)
    io.check_writable(output, suffix)
    begun = time.perf_counter()
    stages = Stages()
    with stages.timed("load the model"):
        known = candidates(model)
    for candidate in known:  # a bad mapping shows now, not later
        candidate.card.scheme.to_asprs(np.empty(0, np.int16), config.asprs)
    with io.open_scan(scan) as reader:
        kept = KeptReader(reader)
        with stages.timed("choose the model"):
            chosen, reason = choose(known, kept)
            misfit = None if reason else suited_better(chosen, kept)
        work = _identity(scan, chosen, config)
        if may_stand:
            result = _finished(place_of(output, work, config.scratch), scan, output, config)
            remove_finished(output, config.scratch)
            if result is not None:
                progress.note(f"{output}: was finished by the run before")
                return result
            check_output(output, inputs, overwrite=overwrite)
        waves = None
        if suffix in LAS_SUFFIXES:
            waves = plan_waveforms(reader.info, output, overwrite=overwrite)
        needed = least_bytes(reader, suffix) + (waves.num_bytes if waves else 0)
        check_room(output.parent, needed, "the labelled scan", "write it elsewhere")
        with stages.timed("load the model"):
            network = chosen.load()
        card = chosen.card
        with workspace(output, work, config.scratch) as place:
            if scheduler is not None:
                scheduler.check(place)
            voxel_scan, tiling = _voxels(
                kept, network, config, place, progress, stages, on_disk=scheduler is not None
            )
            labels = label_voxels(
                network, voxel_scan, tiling, config, place, progress, stages, scheduler
            )
            progress.start(f"writing {output.name}", reader.info.num_points, "points")
            with stages.timed("write"), atomic_path(output) as partial:
                counts, lost = write_labeled(
                    kept, partial, suffix, labels.stitcher, card.scheme, config, progress, stages
                )
                if waves is not None:  # an output that stands has all it refers to
                    waves.write()
                warnings = domain_warnings(
                    card,
                    voxel_scan,
                    labels.neighbor_distance,
                    labels.stitcher.mean_confidence(),
                    reader.info.crs,
                )
                seconds = time.perf_counter() - begun
                num_points = int(counts.sum())
                result = PredictResult(
                    input=scan,
                    output=output,
                    model=chosen.name,
                    reason=reason,
                    num_points=num_points,
                    class_counts=dict(zip(card.scheme.names, counts[1:].tolist(), strict=True)),
                    num_unlabelled=int(counts[0]),
                    num_voxels=len(voxel_scan.voxels),
                    features=tuple(name for name in card.features if name in voxel_scan.features),
                    passes=labels.num_seen / len(voxel_scan.voxels),
                    seconds=seconds,
                    stages=stages.seconds,
                    points_per_second=num_points / seconds,
                    peak_memory=peak_memory(),
                    warnings=(
                        *filter(None, [misfit]),
                        *warnings,
                        *filter(None, [lost, waves.warning if waves else None]),
                    ),
                )
                _note(place, partial, result, config)
    seconds = time.perf_counter() - begun
    return replace(result, seconds=seconds, points_per_second=num_points / seconds)


def _note(place: Path, partial: Path, result: PredictResult, config: PredictConfig) -> None:
    """Note what an output is that is about to appear, should this process be killed then."""
    values = _RESULT.dump_python(result, mode="json")
    settings = config.model_dump(mode="json", include=_OUTPUT)
    with suppress(WriteError):  # a disk that has no room for it has room for the output
        note_finished(place, partial, {"result": values, "settings": settings})


def _finished(place: Path, scan: Path, output: Path, config: PredictConfig) -> PredictResult | None:
    """What a run did that was killed when its output stood; None if that was another work."""
    note = finished(place, output)
    settings = config.model_dump(mode="json", include=_OUTPUT)
    try:
        if note is None or note["settings"] != settings:
            return None
        return replace(_RESULT.validate_python(note["result"]), input=scan, output=output)
    except (KeyError, TypeError, ValidationError):
        return None


def predict(
    points: PointCloud | ArrayLike,
    model: Model | str | Path | None = None,
    config: PredictConfig | None = None,
    *,
    attributes: Mapping[str, NDArray[Any]] | None = None,
    sensor: ArrayLike | None = None,
) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """Label points that are already in memory, such as a robot's frame.

    Args:
        points: A cloud, or coordinates in metres, shape (N, 3).
        model: A model (load it once and keep it), or what :func:`predict_file` takes.
        config: Settings; None takes the defaults.
        attributes: With bare coordinates: further columns such as "intensity" or "red".
        sensor: Where the sensor stood, shape (3,), if known; normals are oriented to it. In a frame
            whose sensor is the origin, points at (0, 0, 0) are pulses that did not return.

    Returns:
        Class indices, shape (N,), int16, -1 for points that are not finite or did not return; and
        the probability of each class, shape (N, C), float32, zero there.

    Raises:
        DataError: There are no finite points, or the model needs features they lack.
    """
    known = candidates(model)
    cloud = points if isinstance(points, PointCloud) else _cloud(points, attributes or {})
    reader = MemoryReader(cloud, sensor)
    model = choose(known, KeptReader(reader))[0].load()
    scan = read_voxels(reader, model.card.prepare.voxel_size)
    # One row more: what a point without a voxel finds at index -1.
    stitched = np.zeros((len(scan.voxels) + 1, model.card.scheme.num_classes), dtype=np.float32)
    for tile in label_tiles(model, scan, config or PredictConfig()):
        stitched[tile.indices] = tile.probabilities
    found = scan.voxels.find(scan.voxels.grid.keys(mask_no_returns(cloud.xyz, reader)))
    labels = np.append(stitched[:-1].argmax(axis=1), -1).astype(np.int16)
    return labels[found], stitched[found]


def _identity(scan: Path, chosen: Candidate, config: PredictConfig) -> dict[str, Any]:
    """All that the labels of a scan's voxels follow from."""
    # A model that is in memory alone has no name to know it by: what is done can't be taken up.
    model = file_hash(chosen.source) if isinstance(chosen.source, Path) else secrets.token_hex()
    # Of max_memory, only the tiles' size makes a difference.
    settings = config.model_dump(mode="json", include={"tile_points", "halo", "precision"})
    return {"scan": identity(scan), "model": model, "settings": settings}


def _voxels(
    kept: KeptReader,
    model: Model,
    config: PredictConfig,
    place: Path,
    progress: Progress,
    stages: Stages,
    *,
    on_disk: bool,
) -> tuple[VoxelScan, Tiling]:
    """A scan's voxels and tiles: those that an earlier run left, or new ones.

    Voxels that memory can hold are read again instead: that takes less time than a tile. `on_disk`
    puts them where other processes find them, however few they are.
    """
    with suppress(CacheError):
        return open_stored(place)
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


def peak_memory() -> int | None:
    """The largest resident size this process has had, in bytes; None where unknown."""
    try:
        import resource
    except ImportError:  # not on Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def _cloud(points: ArrayLike, attributes: Mapping[str, NDArray[Any]]) -> PointCloud:
    xyz = np.asarray(points, dtype=np.float64)
    if xyz.ndim != 2 or xyz.shape[1] != 3 or not len(xyz):
        raise DataError(f"the points have shape {xyz.shape}; expected (N, 3) with N >= 1")
    return PointCloud(xyz, {name: np.asarray(column) for name, column in attributes.items()})
