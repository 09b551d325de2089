"""What of a folder of outputs is done, and of what it was made.

    labeled/.bushseg.json    of each output: a hash of all it follows from, and what the file was

The journal is written before a scan is begun and after it is done. Outputs appear whole or not at
all: one that has appeared since its scan was noted as begun is whole, even if the process was
killed before it could say so.
"""

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from bushseg.cache import FORMAT_VERSION, identity, read_json, write_json
from bushseg.errors import CacheError

JOURNAL = ".bushseg.json"


class _Entry(BaseModel):
    """Of one output.

    Attributes:
        work: The hash of all it follows from.
        file: Identity of the finished output; of one only begun, of what stood there before. None
            for nothing.
        done: Whether it is finished.
    """

    model_config = ConfigDict(extra="forbid")

    work: str
    file: dict[str, str | int] | None
    done: bool


class _Journal(BaseModel):
    model_config = ConfigDict(extra="forbid")

    version: int = FORMAT_VERSION
    outputs: dict[str, _Entry] = {}


class Journal:
    """The journal of one folder, for the one process that works there.

    Args:
        folder: The output folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            self._held = _Journal.model_validate(read_json(folder / JOURNAL))
        except (CacheError, ValidationError):  # none, or damaged: nothing is known to be done
            self._held = _Journal()

    def is_done(self, name: str, work: str) -> bool:
        """Whether an output stands as that work left it."""
        entry, found = self._held.outputs.get(name), self._found(name)
        if entry is None or found is None or entry.work != work:
            return False
        return entry.done == (found == entry.file)

    def begin(self, name: str, work: str) -> None:
        """Note that an output is about to be made.

        Raises:
            WriteError: The journal can't be written.
        """
        self._note(name, _Entry(work=work, file=self._found(name), done=False))

    def finish(self, name: str, work: str) -> None:
        """Note that an output is done.

        Raises:
            WriteError: The journal can't be written.
        """
        self._note(name, _Entry(work=work, file=self._found(name), done=True))

    def forget(self, name: str) -> None:
        """Note that nothing is known of an output."""
        self._note(name, None)

    def _note(self, name: str, entry: _Entry | None) -> None:
        if entry is None:
            self._held.outputs.pop(name, None)
        else:
            self._held.outputs[name] = entry
        write_json(self._folder / JOURNAL, self._held.model_dump(mode="json"))

    def _found(self, name: str) -> dict[str, Any] | None:
        """What tells an output from another: not its place, so that folders may be moved."""
        try:
            found = identity(self._folder / name)
        except OSError:
            return None
        del found["path"]
        return found
