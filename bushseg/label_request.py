"""What is asked where one scan is to be labelled, and what is refused before any work is done."""

import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bushseg import io
from bushseg.bundled import file_hash
from bushseg.cache import identity
from bushseg.config import PredictConfig
from bushseg.files import check_output
from bushseg.io.base import ScanReader
from bushseg.io.sizes import least_bytes
from bushseg.labeled_scan import LAS_SUFFIXES
from bushseg.model_choice import Candidate, Choice, candidates
from bushseg.prediction_result import PredictResult, noted_result
from bushseg.room import check_room
from bushseg.waveforms import WaveformCopy, plan_waveforms
from bushseg.workspace import may_be_finished, place_of, remove_finished


@dataclass(frozen=True, slots=True)
class LabelRequest:
    """One scan to label.

    Attributes:
        scan: The scan.
        output: The file to write.
        config: Settings; tiles have the size that memory allows.
        overwrite: Whether an existing output may be replaced.
    """

    scan: Path
    output: Path
    config: PredictConfig
    overwrite: bool

    @property
    def suffix(self) -> str:
        """The output's, which decides its format."""
        return io.suffix_of(self.output)

    def check(self) -> bool:
        """Refuse an output that can't be, or must not be replaced.

        Returns:
            Whether the output may be there since a run was killed when it stood, before it had
            tidied up: :meth:`take_finished` tells.

        Raises:
            BushsegError: What is wrong with it.
        """
        may_stand = may_be_finished(self.output, self.config.scratch)
        self._check_output(overwrite=self.overwrite or may_stand)
        io.check_writable(self.output, self.suffix)
        return may_stand

    def models(self, model: Choice) -> list[Candidate]:
        """The models that may be used, all of which know the classes that codes are given for.

        Raises:
            BushsegError: There is none, or one doesn't.
        """
        known = candidates(model)
        for candidate in known:  # a bad mapping shows now, not later
            candidate.card.scheme.to_asprs(np.empty(0, np.int16), self.config.asprs)
        return known

    def work(self, chosen: Candidate) -> dict[str, Any]:
        """All that the labels of the scan's voxels follow from."""
        # A model that is in memory alone has no name to know it by: what is done can't be taken up.
        source = chosen.source
        model = file_hash(source) if isinstance(source, Path) else secrets.token_hex()
        # Of max_memory, only the tiles' size makes a difference, and that halos count towards it.
        settings = self.config.model_dump(mode="json", include={"tile_points", "halo", "precision"})
        settings["bounded"] = self.config.max_memory is not None
        return {"scan": identity(self.scan), "model": model, "settings": settings}

    def take_finished(self, work: dict[str, Any]) -> PredictResult | None:
        """What the run did that was killed when the output stood, and tidy up after it.

        Returns:
            None if that was another work, and the output may be replaced.

        Raises:
            WriteError: It was another work, and the output may not be replaced.
        """
        place = place_of(self.output, work, self.config.scratch)
        result = noted_result(place, self.scan, self.output, self.config)
        remove_finished(self.output, self.config.scratch)
        if result is None:
            self._check_output(overwrite=self.overwrite)
        return result

    def plan_output(self, reader: ScanReader) -> WaveformCopy | None:
        """See whether there is room for the output and what goes beside it.

        Returns:
            What is to be done about the scan's waveforms, if the output can refer to them.

        Raises:
            WriteError: There is no room, or another file is in the way.
        """
        waveforms = None
        if self.suffix in LAS_SUFFIXES:
            waveforms = plan_waveforms(reader.info, self.output, overwrite=self.overwrite)
        needed = least_bytes(reader, self.suffix) + (waveforms.num_bytes if waveforms else 0)
        check_room(self.output.parent, needed, "the labelled scan", "write it elsewhere")
        return waveforms

    def _check_output(self, *, overwrite: bool) -> None:
        inputs = (self.scan, *filter(None, [io.label_sidecar(self.scan)]))
        check_output(self.output, inputs, overwrite=overwrite)
