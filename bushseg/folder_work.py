"""The scans of a folder: which is to be labelled, and what became of it."""

import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, NoReturn

from bushseg import io
from bushseg.bundled import file_hash
from bushseg.cache import fingerprint, identity
from bushseg.config import PredictConfig
from bushseg.errors import WriteError
from bushseg.folder_journal import Journal
from bushseg.folder_plan import Planned
from bushseg.model_choice import Candidate
from bushseg.prediction_result import PredictResult
from bushseg.progress import Progress
from bushseg.workspace import remove_finished

Status = Literal["done", "skipped", "failed", "left"]

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
class FolderWork:
    """How a folder's scans are to be labelled.

    Attributes:
        folder: The folder of the outputs, which nobody else works in.
        journal: Its journal.
        known: The models that may be used.
        config: Settings.
        overwrite: Whether outputs may be replaced that were made otherwise, or by others.
        verify: Whether to compare each new output with its scan.
        progress: Told of each scan's progress, or of scans where other processes label them.
        common: All that outputs follow from, but for the scan (:func:`common_work`).
    """

    folder: Path
    journal: Journal
    known: tuple[Candidate, ...]
    config: PredictConfig
    overwrite: bool
    verify: bool
    progress: Progress
    common: dict[str, Any]

    def due(self, it: Planned) -> str | None:
        """A hash of all that an output follows from; None if it is done.

        Raises:
            OSError: The scan can't be read.
            WriteError: Something else stands where the output should.
        """
        work = fingerprint({**self.common, **_identity(it.scan)})
        if self.journal.is_done(it.name, work):
            remove_finished(it.output, self.config.scratch)
            return None
        if it.output.exists() and not self.overwrite:
            raise WriteError(
                f"{it.output}: exists already, and not as made of this scan with this model and "
                "these settings; pass --overwrite to replace it"
            )
        return work

    def refuse(self, it: Planned, difference: str) -> NoReturn:
        """Say that an output isn't its scan, and so isn't done.

        Raises:
            WriteError: In any case.
        """
        self.journal.forget(it.name)
        raise WriteError(f"{it.output}: differs from {it.scan}: {difference}")


def common_work(known: Sequence[Candidate], config: PredictConfig) -> dict[str, Any]:
    """All that outputs follow from, but for the scan."""
    models = [
        # A model that is in memory alone has no name to know it by.
        file_hash(it.source) if isinstance(it.source, Path) else secrets.token_hex()
        for it in known
    ]
    settings = config.model_dump(mode="json", include=_SETTINGS)
    return {"bushseg": version("bushseg"), "models": models, "settings": settings}


def _identity(scan: Path) -> dict[str, Any]:
    """What tells one scan from another; its place doesn't, so that folders may be moved."""
    found = identity(scan)
    del found["path"]
    return {"scan": found, "suffix": io.suffix_of(scan)}
