"""What of a folder of outputs is done, and of what it was made.

    labeled/.bushseg.json    of each output: a hash of all it follows from, and what the file was

The journal is written before a scan is begun and after it is done. Outputs appear whole or not at
all: one that has appeared since its scan was noted as begun is whole, even if the process was
killed before it could say so.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from bushseg.cache import FORMAT_VERSION, output_identity, read_json, write_json
from bushseg.errors import CacheError
from bushseg.files import remove_partials

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
        remove_partials(folder / JOURNAL)
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

    def begin(self, works: Mapping[str, str]) -> None:
        """Note that outputs are about to be made.

        Args:
            works: The outputs' names, and the hash of all that each follows from.

        Raises:
            WriteError: The journal can't be written.
        """
        for name, work in works.items():
            self._held.outputs[name] = _Entry(work=work, file=self._found(name), done=False)
        self._write()

    def finish(self, name: str, work: str, file: dict[str, str | int] | None = None) -> None:
        """Note that an output is done.

        Args:
            name: The output.
            work: The hash of all it follows from.
            file: What :func:`bushseg.cache.output_identity` said of it to the process that made it;
                None asks.

        Raises:
            WriteError: The journal can't be written.
        """
        file = file or self._found(name)
        self._held.outputs[name] = _Entry(work=work, file=file, done=True)
        self._write()

    def forget(self, name: str) -> None:
        """Note that nothing is known of an output."""
        self._held.outputs.pop(name, None)
        self._write()

    def _write(self) -> None:
        write_json(self._folder / JOURNAL, self._held.model_dump(mode="json"))

    def _found(self, name: str) -> dict[str, Any] | None:
        try:
            return output_identity(self._folder / name)
        except OSError:
            return None
