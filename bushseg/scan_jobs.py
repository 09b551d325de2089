"""One scan as a job of another process: from a file to a labelled file, and a note of the rest."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypedDict

from pydantic import TypeAdapter, ValidationError

from bushseg.bundled import file_hash
from bushseg.cache import FORMAT_VERSION, output_identity, read_json, write_json
from bushseg.checkpoint import Model, read_card, save_model
from bushseg.config import PredictConfig
from bushseg.errors import CacheError, ReadError
from bushseg.file_labelling import label_file
from bushseg.memory import give_back
from bushseg.model_choice import Candidate
from bushseg.prediction_result import PredictResult
from bushseg.tile_jobs import check_model_file
from bushseg.verification import verify as prove


class ModelFile(TypedDict):
    """A model that a job may use.

    Attributes:
        name: For people.
        path: Its file, absolute.
        digest: SHA-256 of that file.
    """

    name: str
    path: str
    digest: str


@dataclass(frozen=True, slots=True)
class Note:
    """What a job leaves beside the output that it made.

    Attributes:
        result: What it did.
        file: What tells the output from another (:func:`bushseg.cache.output_identity`).
        difference: In what the output differs from its scan; None if in nothing, or if that wasn't
            asked.
    """

    result: PredictResult
    file: dict[str, str | int]
    difference: str | None


_NOTE = TypeAdapter(Note)


def label_scan_job(
    folder: str,
    number: int,
    scan: str,
    output: str,
    models: Sequence[ModelFile],
    settings: Mapping[str, Any],
    overwrite: bool,
    verify: bool,
) -> None:
    """Label one scan as :func:`bushseg.predict_file` does, in one process, and leave a note.

    Args:
        folder: Where the note (:class:`Note`) goes.
        number: Which of the notes there.
        scan: The scan, absolute.
        output: The file to write, absolute.
        models: Those that may be used.
        settings: What of :class:`PredictConfig` isn't as by default.
        overwrite: Whether an existing output may be replaced.
        verify: Whether to compare the output with the scan.

    Raises:
        BushsegError: As :func:`bushseg.predict_file`; or a model's file isn't the one that is
            meant.
    """
    path = note_path(Path(folder), number)
    is_second_try = path.exists()
    note = _left(path, Path(output))
    if note is None:
        path.touch()
        known = tuple(map(_candidate, models))
        config = PredictConfig.from_dict(dict(settings), "job")
        if not Path(scan).exists():
            raise ReadError(scan, "isn't there for the worker", "a folder that all workers share")
        # What the first try has made, and died before it could say so, is its own to replace.
        overwrite |= is_second_try
        result = label_file(scan, output, known, config, None, overwrite=overwrite)
        note = Note(result, output_identity(Path(output)), None)
        _write(path, note)
    if verify:
        proof = prove(scan, output)
        if not proof.equal:
            _write(path, replace(note, difference=proof.differences[0]))
    give_back()


def _left(path: Path, output: Path) -> Note | None:
    """What a try has left whose process died while it verified."""
    try:
        note = _read(path)
        return note if note.file == output_identity(output) else None
    except (CacheError, OSError):
        return None


def _candidate(model: ModelFile) -> Candidate:
    """A model that may be used, checked to be the one that is meant."""
    check_model_file(model["path"], model["digest"])
    return Candidate(model["name"], read_card(model["path"]), Path(model["path"]))


def model_files(known: Sequence[Candidate], folder: Path) -> list[ModelFile]:
    """Models as jobs are told of them; what is in memory alone is written to a folder.

    Raises:
        CheckpointError: A model's file is damaged.
        WriteError: A model can't be written.
    """
    found = []
    for number, it in enumerate(known):
        if isinstance(it.source, Model):
            path = folder / f"model-{number}.safetensors"
            save_model(path, it.source.card, it.source.network)
        else:
            path = it.source
        found.append(ModelFile(name=it.name, path=str(path.absolute()), digest=file_hash(path)))
    return found


def note_path(folder: Path, number: int) -> Path:
    """Where a job's note is."""
    return folder / f"note-{number}.json"


def read_note(folder: Path, number: int) -> Note:
    """The note of a job that is done.

    Raises:
        CacheError: There is none, or it is damaged.
    """
    return _read(note_path(folder, number))


def _read(path: Path) -> Note:
    try:
        return _NOTE.validate_python(read_json(path).get("note"))
    except ValidationError as error:
        raise CacheError(f"{path}: is no note of a labelled scan ({error})") from error


def _write(path: Path, note: Note) -> None:
    write_json(path, {"version": FORMAT_VERSION, "note": _NOTE.dump_python(note, mode="json")})
