"""Many scans in, many labelled scans out; what is done is skipped, what is broken passed over."""

import errno
import re
import secrets
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np

from bushseg import io
from bushseg.bundled import file_hash
from bushseg.cache import fingerprint, identity
from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.errors import BushsegError, WriteError
from bushseg.folder_journal import Journal
from bushseg.folder_plan import Planned, plan_folder
from bushseg.locks import locked
from bushseg.model_choice import Candidate, candidates
from bushseg.prediction import PredictResult, predict_file
from bushseg.progress import SILENT, Progress
from bushseg.verification import verify as prove

LOCK = ".bushseg.lock"

Status = Literal["done", "skipped", "failed", "left"]

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}
"""What the system says when no further scan could be written either."""

_SETTINGS = {"tile_points", "max_memory", "halo", "precision", "keep_classification", "asprs"}


@dataclass(frozen=True, slots=True)
class ScanOutcome:
    """What became of one scan.

    Attributes:
        input: The scan.
        output: Its output.
        status: "done"; "skipped", since an earlier run had done it; "failed"; "left", since the
            disk was full before its turn came.
        error: Why it failed, one line; else empty.
        result: What labelling it did; None where it wasn't labelled now.
    """

    input: Path
    output: Path
    status: Status
    error: str = ""
    result: PredictResult | None = None


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
    full disk does.

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
    outcomes: list[ScanOutcome] = []
    with locked(folder, LOCK):
        journal, common = Journal(folder), _common(known, config)
        full = False
        for number, it in enumerate(plan, 1):
            outcome = ScanOutcome(it.scan, it.output, "left")
            if not full:
                try:
                    work = fingerprint(common | _identity(it.scan))
                    outcome = _label(it, work, journal, known, config, overwrite, verify, progress)
                except (BushsegError, OSError, MemoryError) as error:
                    full = _is_full(error)
                    message = str(error) or "out of memory"
                    outcome = ScanOutcome(it.scan, it.output, "failed", message)
                progress.note(f"[{number} of {len(plan)}] {_line(outcome)}")
            outcomes.append(outcome)
    return FolderResult(
        output=folder,
        scans=tuple(outcomes),
        num_points=sum(it.result.num_points for it in outcomes if it.result is not None),
        seconds=time.perf_counter() - begun,
    )


def _label(
    it: Planned,
    work: str,
    journal: Journal,
    known: tuple[Candidate, ...],
    config: PredictConfig,
    overwrite: bool,
    verify: bool,
    progress: Progress,
) -> ScanOutcome:
    """Label one scan, unless it is done."""
    if journal.is_done(it.name, work):
        return ScanOutcome(it.scan, it.output, "skipped")
    if it.output.exists() and not overwrite:
        raise WriteError(
            f"{it.output}: exists already, and not as made of this scan with this model and these "
            "settings; pass --overwrite to replace it"
        )
    journal.begin(it.name, work)
    result = predict_file(it.scan, it.output, known, config, overwrite=overwrite, progress=progress)
    if verify:
        proof = prove(it.scan, it.output, progress=progress)
        if not proof.equal:
            journal.forget(it.name)
            raise WriteError(f"{it.output}: differs from {it.scan}: {proof.differences[0]}")
    journal.finish(it.name, work)
    return ScanOutcome(it.scan, it.output, "done", result=result)


def _common(known: Sequence[Candidate], config: PredictConfig) -> dict[str, object]:
    """All that outputs follow from, but for the scan."""
    models = [
        # A model that is in memory alone has no name to know it by.
        file_hash(it.source) if isinstance(it.source, Path) else secrets.token_hex()
        for it in known
    ]
    settings = config.model_dump(mode="json", include=_SETTINGS)
    return {"bushseg": version("bushseg"), "models": models, "settings": settings}


def _identity(scan: Path) -> dict[str, object]:
    """What tells one scan from another; its place doesn't, so that folders may be moved."""
    found = identity(scan)
    del found["path"]
    return {"scan": found, "suffix": io.suffix_of(scan)}


def _is_full(error: BaseException | None) -> bool:
    """Whether the disk is to blame, so that no other scan would fare better."""
    while error is not None:
        # What libraries written in Rust say of the system ends so.
        told = re.search(r"\(os error (\d+)\)", str(error))
        number = error.errno if isinstance(error, OSError) else told and int(told[1])
        if number in _FULL:
            return True
        error = error.__cause__ or error.__context__
    return False


def _line(outcome: ScanOutcome) -> str:
    """What became of a scan, for people."""
    if outcome.result is not None:
        result = outcome.result
        return f"{outcome.output}: {result.num_points:,} points in {result.seconds:.1f} s"
    return f"{outcome.output}: done before" if not outcome.error else f"failed: {outcome.error}"
