"""Where a run keeps what it has done so far, so that the same command goes on after it was killed.

One folder beside the output, hidden, which one process at a time may use. In it a folder that is
named by a hash of all the work follows from, so that a run with another model or other settings
doesn't take up what isn't its own.
"""

import hashlib
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from bushseg.cache import FORMAT_VERSION, fingerprint, output_identity, read_json, write_json
from bushseg.errors import CacheError, WriteError
from bushseg.files import remove_partials
from bushseg.locks import LOCK, locked

_SUFFIX = ".json"


@contextmanager
def workspace(
    output: Path, identity: Mapping[str, Any], folder: Path | None = None
) -> Iterator[Path]:
    """Yield a folder for what goes into an output; it is removed when the output is done.

    If the block raises, what it left in the folder stays for the next run.

    Args:
        output: The output.
        identity: All that the work follows from, as JSON can hold it.
        folder: Where the workspace stands; None for beside the output.

    Yields:
        The folder, which need not exist.

    Raises:
        WriteError: Another process works on this output, or nothing can be written there.
    """
    place = place_of(output, identity, folder)
    root = place.parent
    try:
        with locked(root):
            remove_partials(output)
            for other in root.iterdir():
                if other not in (place, _note(place)) and other.name != LOCK:
                    _remove(other)
            yield place
            _remove(place)
            _remove(_note(place))  # last: while anything is left, it tells of a finished output
    finally:
        with suppress(OSError):  # it isn't empty: there is something to go on with
            root.rmdir()


def place_of(output: Path, identity: Mapping[str, Any], folder: Path | None = None) -> Path:
    """The folder that :func:`workspace` yields."""
    return _root(output, folder) / fingerprint(identity)


def note_finished(place: Path, partial: Path, result: Mapping[str, Any]) -> None:
    """Note that an output is whole, just before it is moved into place.

    Args:
        place: What :func:`workspace` gave for it.
        partial: The output, where it was written.
        result: What is to be known of it, as JSON can hold it.

    Raises:
        WriteError: The note can't be written.
    """
    file = output_identity(partial)
    write_json(_note(place), {"version": FORMAT_VERSION, "file": file, "result": dict(result)})


def finished(place: Path, output: Path) -> Any:
    """What a run noted of an output that was killed when this stood, before it had tidied up.

    Args:
        place: That of the same work (:func:`place_of`).
        output: The output.

    Returns:
        The result as it was noted; None if the output isn't one that such a run has made.
    """
    try:
        note = read_json(_note(place))
        return note.get("result") if note.get("file") == output_identity(output) else None
    except (CacheError, OSError):
        return None


def may_be_finished(output: Path, folder: Path | None = None) -> bool:
    """Whether a run, of whatever work, has made an output and was killed before it had tidied up.

    Args:
        output: The output.
        folder: As :func:`workspace` takes it.
    """
    try:
        notes = list(_root(output, folder).glob(f"*{_SUFFIX}"))
    except OSError:  # a path that can't be
        return False
    return any(finished(note.with_suffix(""), output) is not None for note in notes)


def remove_finished(output: Path, folder: Path | None = None) -> None:
    """Remove what such a run has left.

    Args:
        output: The output.
        folder: As :func:`workspace` takes it.
    """
    if not may_be_finished(output, folder):
        return
    root = _root(output, folder)
    with suppress(OSError, WriteError):  # somebody is at work
        with locked(root):
            left = [path for path in root.iterdir() if path.name != LOCK]
            for path in sorted(left, key=lambda path: path.suffix == _SUFFIX):
                _remove(path)
        root.rmdir()


def _note(place: Path) -> Path:
    return place.with_name(place.name + _SUFFIX)


def _remove(path: Path) -> None:
    """Remove a file or a folder, as far as that can be done."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


def _root(output: Path, folder: Path | None) -> Path:
    target = Path(os.path.realpath(output))
    digest = hashlib.sha256(os.fsencode(target)).hexdigest()[:8]
    return (folder or target.parent) / f".{target.name[:40]}-{digest}.bushseg"
