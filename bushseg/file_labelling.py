"""One scan labelled, from file to file.

Two passes over the scan: the first streams it into voxels, which the network labels tile by tile;
the second streams it again, looks every point's voxel up, and writes it with all it had.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg import io
from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.domain import domain_warnings
from bushseg.files import atomic_path
from bushseg.io.kept import KeptReader
from bushseg.jobs import Scheduler
from bushseg.label_request import LabelRequest
from bushseg.labeled_scan import write_labeled
from bushseg.memory import be_lean, fit, peak_memory
from bushseg.model_choice import Candidate, Choice, choose, suited_better
from bushseg.prediction_result import PredictResult, note_result
from bushseg.progress import SILENT, Progress
from bushseg.scan import VoxelScan
from bushseg.stages import Stages
from bushseg.tiled_scan import tile_scan
from bushseg.voxel_labels import VoxelLabels, label_voxels
from bushseg.waveforms import WaveformCopy
from bushseg.workspace import workspace


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
    """As :func:`bushseg.predict_file`, with a scheduler that is open already.

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
    request = LabelRequest(Path(scan), Path(output), _within_memory(config), overwrite)
    may_stand = request.check()
    begun, stages = time.perf_counter(), Stages()
    with stages.timed("load the model"):
        known = request.models(model)
    with io.open_scan(request.scan) as reader:
        kept = KeptReader(reader)
        with stages.timed("choose the model"):
            chosen, reason = choose(known, kept)
            misfit = None if reason else suited_better(chosen, kept)
        work = request.work(chosen)
        if may_stand and (result := request.take_finished(work)) is not None:
            progress.note(f"{request.output}: was finished by the run before")
            return result
        waveforms = request.plan_output(reader)
        with stages.timed("load the model"):
            network = chosen.load()
        labelling = _Labelling(request, kept, chosen, reason, misfit, progress, stages, begun)
        with workspace(request.output, work, request.config.scratch) as place:
            voxels, labels = labelling.label(place, network, scheduler)
            result = labelling.write(place, voxels, labels, waveforms)
    return result.after(time.perf_counter() - begun)


def _within_memory(config: PredictConfig) -> PredictConfig:
    """Settings whose tiles fit the memory to keep within, if there is such a limit."""
    if config.max_memory is None:
        return config
    be_lean()
    sizes = fit(config.max_memory, config.workers)
    return config.model_copy(update={"tile_points": sizes.tile_points})


@dataclass(frozen=True, slots=True)
class _Labelling:
    """The work on one scan, once it is known what is to be done; see :func:`label_file`.

    Attributes:
        request: What is asked.
        kept: The scan.
        chosen: The model.
        reason: Why this one, where the scan decided; else empty.
        misfit: A warning, if it was named and another one suits the scan better.
        progress: Told of what is done.
        stages: Told of the time that each step takes.
        begun: When the work began.
    """

    request: LabelRequest
    kept: KeptReader
    chosen: Candidate
    reason: str
    misfit: str | None
    progress: Progress
    stages: Stages
    begun: float

    def label(
        self, place: Path, model: Model, scheduler: Scheduler | None
    ) -> tuple[VoxelScan, VoxelLabels]:
        """Stream the scan into voxels, and label these."""
        config, progress, stages = self.request.config, self.progress, self.stages
        if scheduler is not None:
            scheduler.check(place)
        on_disk = scheduler is not None
        scan, tiling = tile_scan(self.kept, model, config, place, progress, stages, on_disk=on_disk)
        return scan, label_voxels(model, scan, tiling, config, place, progress, stages, scheduler)

    def write(
        self, place: Path, scan: VoxelScan, labels: VoxelLabels, waveforms: WaveformCopy | None
    ) -> PredictResult:
        """Stream it again and write it, with a note in case this process is killed just then."""
        output, config = self.request.output, self.request.config
        scheme, stages = self.chosen.card.scheme, self.stages
        self.progress.start(f"writing {output.name}", self.kept.info.num_points, "points")
        with stages.timed("write"), atomic_path(output) as partial:
            counts, lost = write_labeled(
                self.kept,
                partial,
                self.request.suffix,
                labels.stitcher,
                scheme,
                config,
                self.progress,
                stages,
            )
            if waveforms is not None:  # an output that stands has all it refers to
                waveforms.write()
            result = self._result(scan, labels, counts, lost, waveforms)
            note_result(place, partial, result, config)
        return result

    def _result(
        self,
        scan: VoxelScan,
        labels: VoxelLabels,
        counts: NDArray[np.int64],
        lost: str | None,
        waveforms: WaveformCopy | None,
    ) -> PredictResult:
        """What was done up to now."""
        card = self.chosen.card
        confidence, crs = labels.stitcher.mean_confidence(), self.kept.info.crs
        foreign = domain_warnings(card, scan, labels.neighbor_distance, confidence, crs)
        missing = waveforms.warning if waveforms else None
        seconds, num_points = time.perf_counter() - self.begun, int(counts.sum())
        return PredictResult(
            input=self.request.scan,
            output=self.request.output,
            model=self.chosen.name,
            reason=self.reason,
            num_points=num_points,
            class_counts=dict(zip(card.scheme.names, counts[1:].tolist(), strict=True)),
            num_unlabelled=int(counts[0]),
            num_voxels=len(scan.voxels),
            features=tuple(name for name in card.features if name in scan.features),
            passes=labels.num_seen / len(scan.voxels),
            seconds=seconds,
            stages=self.stages.seconds,
            points_per_second=num_points / seconds,
            peak_memory=peak_memory(),
            warnings=tuple(filter(None, [self.misfit, *foreign, lost, missing])),
        )
