"""What labelling one scan did; and a note of it that outlives a kill at the very end."""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from bushseg.config import PredictConfig
from bushseg.errors import WriteError
from bushseg.workspace import finished, note_finished


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

    def after(self, seconds: float) -> "PredictResult":
        """The same, when so much time had passed."""
        return replace(self, seconds=seconds, points_per_second=self.num_points / seconds)


_RESULT = TypeAdapter(PredictResult)
_OUTPUT = {"keep_classification", "asprs"}
"""What outputs follow from beside their voxels' labels."""


def note_result(place: Path, partial: Path, result: PredictResult, config: PredictConfig) -> None:
    """Note what an output is that is about to appear, should this process be killed then.

    Args:
        place: What :func:`bushseg.workspace.workspace` gave for it.
        partial: The output, where it was written.
        result: What is to be known of it.
        config: What it was made with.
    """
    values = _RESULT.dump_python(result, mode="json")
    with suppress(WriteError):  # a disk that has no room for it has room for the output
        note_finished(place, partial, {"result": values, "settings": _settings(config)})


def noted_result(
    place: Path, scan: Path, output: Path, config: PredictConfig
) -> PredictResult | None:
    """What a run did that was killed when its output stood; None if that was another work.

    Args:
        place: That of the same work (:func:`bushseg.workspace.place_of`).
        scan: The scan, as it is named now.
        output: The output, likewise.
        config: What it is to be made with.
    """
    note = finished(place, output)
    try:
        if note is None or note["settings"] != _settings(config):
            return None
        return replace(_RESULT.validate_python(note["result"]), input=scan, output=output)
    except (KeyError, TypeError, ValidationError):
        return None


def _settings(config: PredictConfig) -> dict[str, Any]:
    return config.model_dump(mode="json", include=_OUTPUT)
