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

from bushseg.cache import fingerprint
from bushseg.errors import WriteError
from bushseg.files import remove_partials
from bushseg.locks import LOCK, locked


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
    root = _root(output, folder)
    place = root / fingerprint(identity)
    try:
        with locked(root):
            remove_partials(output)
            for other in root.iterdir():
                if other != place and other.name != LOCK:
                    shutil.rmtree(other, ignore_errors=True)
            yield place
            shutil.rmtree(place, ignore_errors=True)
    finally:
        with suppress(OSError):  # it isn't empty: there is something to go on with
            root.rmdir()


def remove_finished(output: Path, folder: Path | None = None) -> None:
    """Remove what a run left that was killed when its output was done, before it had tidied up.

    Args:
        output: The output; nothing is done unless it is newer than all that was left.
        folder: As :func:`workspace` takes it.
    """
    root = _root(output, folder)
    try:
        left = [path for path in root.iterdir() if path.name != LOCK]
        files = [file for path in left for file in path.rglob("*")]
        newest = max((file.stat().st_mtime_ns for file in files), default=0)
        if newest >= output.stat().st_mtime_ns:
            return
        with locked(root):
            for path in left:
                shutil.rmtree(path, ignore_errors=True)
        root.rmdir()
    except (OSError, WriteError):  # there is nothing, or somebody is at work
        return


def _root(output: Path, folder: Path | None) -> Path:
    target = Path(os.path.realpath(output))
    digest = hashlib.sha256(os.fsencode(target)).hexdigest()[:8]
    return (folder or target.parent) / f".{target.name[:40]}-{digest}.bushseg"
