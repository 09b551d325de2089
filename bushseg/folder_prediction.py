"""Many scans in, many labelled scans out; what is done is skipped, what is broken passed over."""

import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.folder_journal import Journal
from bushseg.folder_labelling import label_scans
from bushseg.folder_plan import plan_folder
from bushseg.folder_work import FolderWork, ScanOutcome, Status, common_work
from bushseg.locks import locked
from bushseg.model_choice import candidates
from bushseg.progress import SILENT, Progress
from bushseg.schedulers import opened

LOCK = ".bushseg.lock"


@dataclass(frozen=True, slots=True)
class FolderResult:
    """What labelling many scans did.

    Attributes:
        output: The folder of the outputs.
        scans: What became of each scan, in order.
        num_points: Points labelled now.
        seconds: From the first scan to the last output.
    """

    output: Path
    scans: tuple[ScanOutcome, ...]
    num_points: int
    seconds: float

    def count(self, status: Status) -> int:
        """How many scans are of a status."""
        return sum(scan.status == status for scan in self.scans)

    @property
    def complete(self) -> bool:
        """Whether every scan has its output."""
        return all(scan.status in ("done", "skipped") for scan in self.scans)


def predict_folder(
    paths: str | Path | Iterable[str | Path],
    output: str | Path,
    model: Model | str | Path | None = None,
    config: PredictConfig | None = None,
    *,
    suffix: str | None = None,
    overwrite: bool = False,
    verify: bool = False,
    progress: Progress = SILENT,
) -> FolderResult:
    """Label every scan of some folders, as :func:`bushseg.predict_file` labels one.

    Outputs have the scans' places and names (:func:`bushseg.folder_plan.plan_folder`). An output
    that an earlier run made of the same scan with the same model and settings is kept, so a run
    that was stopped goes on where it was. A scan that can't be labelled doesn't stop the others; a
    full disk does. Other processes (`config.workers`, `config.scheduler`) each label a scan of
    their own; where there are fewer scans than those, the tiles of one.

    Args:
        paths: Scans, or folders that are searched for them.
        output: The folder of the outputs; it need not exist.
        model: As :func:`bushseg.predict_file` takes it. Where it leaves a choice, each scan has its
            own.
        config: Settings; None takes the defaults.
        suffix: The outputs' suffix, such as ".laz"; None: the scan's own, where that is written.
        overwrite: Whether outputs may be replaced that were made otherwise, or by others.
        verify: Whether to compare each new output with its scan.
        progress: Told of each scan's progress, and in a line of what became of it.

    Returns:
        What became of each scan.

    Raises:
        BushsegError: Nothing can be begun: there are no scans, outputs would fall on each other or
            on inputs, the model or a setting is unfit, or another process works in the folder.
    """
    config, folder = config or PredictConfig(), Path(output)
    begun = time.perf_counter()
    plan = plan_folder([paths] if isinstance(paths, str | Path) else paths, folder, suffix)
    known = tuple(candidates(model))
    for candidate in known:  # a bad mapping shows now, not in every scan
        candidate.card.scheme.to_asprs(np.empty(0, np.int16), config.asprs)
    outcomes = {number: ScanOutcome(it.scan, it.output, "left") for number, it in enumerate(plan)}
    with (
        opened(config.workers, config.scheduler, insecure=config.insecure_scheduler) as scheduler,
        locked(folder, LOCK),
    ):
        work = FolderWork(
            folder,
            Journal(folder),
            known,
            config,
            overwrite,
            verify,
            progress,
            common_work(known, config),
        )
        for ended, (number, outcome) in enumerate(label_scans(work, plan, scheduler), 1):
            outcomes[number] = outcome
            progress.note(f"[{ended} of {len(plan)}] {_line(outcome)}")
    return FolderResult(
        output=folder,
        scans=tuple(outcomes.values()),
        num_points=sum(it.result.num_points for it in outcomes.values() if it.result is not None),
        seconds=time.perf_counter() - begun,
    )


def _line(outcome: ScanOutcome) -> str:
    """What became of a scan, for people."""
    if outcome.result is not None:
        result = outcome.result
        return f"{outcome.output}: {result.num_points:,} points in {result.seconds:.1f} s"
    return f"{outcome.output}: done before" if not outcome.error else f"failed: {outcome.error}"
