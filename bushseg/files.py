"""Outputs appear whole or not at all."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bushseg.errors import WriteError

_PARTIAL = ".partial"
_LONGEST_NAME = 255  # bytes, of every common file system


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; move it into place if the block succeeds.

    The temporary file is synced before it is renamed, so that after a crash `path` holds either its
    old content or all of the new. A symbolic link is followed: its target is replaced, the link
    stays. If the block raises, the temporary file is removed and `path` is untouched; a WriteError
    of the block that names the temporary file names `path` instead.

    Args:
        path: Where the output shall stand. Its folder is created if need be.

    Raises:
        WriteError: The folder can't be created or written to, or the disk is full.
    """
    target = Path(os.path.realpath(path))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        # The suffix stays last: libraries choose their format by it.
        handle, name = tempfile.mkstemp(
            prefix=f".{target.stem[:40]}-", suffix=f"{_PARTIAL}{target.suffix}", dir=target.parent
        )
        os.close(handle)
    except OSError as error:
        raise WriteError(f"{path}: can't write here ({error.strerror or error})") from error
    partial = Path(name)
    try:
        yield partial
        _move(partial, target, path)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        if isinstance(error, WriteError) and name in str(error):
            raise WriteError(str(error).replace(name, str(path))) from error
        raise


def remove_partials(path: str | Path) -> None:
    """Remove what killed processes left of an output they were writing.

    To be called by one who knows that no other process is writing it (:mod:`bushseg.locks`).

    Args:
        path: The output, as it was given to :func:`atomic_path`.
    """
    target = Path(os.path.realpath(path))
    prefix, suffix = f".{target.stem[:40]}-", f"{_PARTIAL}{target.suffix}"
    with suppress(OSError):
        for found in target.parent.iterdir():
            # mkstemp puts eight letters, digits or underscores between them.
            middle = found.name.removeprefix(prefix).removesuffix(suffix)
            if found.name == prefix + middle + suffix and len(middle) == 8:
                found.unlink()


def remove_partials_in(folder: Path) -> None:
    """Remove what killed processes left of any output in a folder.

    To be called by one who knows that no other process is writing there.
    """
    with suppress(OSError):
        for found in folder.glob(f".*-????????{_PARTIAL}*"):
            found.unlink()


def check_output(
    output: str | Path, inputs: tuple[str | Path, ...] = (), *, overwrite: bool
) -> None:
    """Refuse an output that would destroy something, before any work is done.

    Args:
        output: The file to be written.
        inputs: Files that must survive.
        overwrite: Whether an existing output may be replaced.

    Raises:
        WriteError: The output is one of the inputs, is a folder, exists and may not be replaced, or
            has a name that can't be.
    """
    path = Path(output)
    _check_name(path)
    if path.is_dir():
        raise WriteError(f"{path}: is a folder; give the output a file name")
    if not path.exists():
        return
    for source in inputs:
        if Path(source).exists() and path.samefile(source):
            raise WriteError(f"{path}: is the input itself; choose another output name")
    if not overwrite:
        raise WriteError(f"{path}: exists already; pass --overwrite to replace it")


def _check_name(path: Path) -> None:
    """Refuse what no file can be called: it would show only when all the work is done."""
    shown = f"{str(path)[:60]}..."
    longest = max((len(os.fsencode(part)) for part in path.parts), default=0)
    if longest > _LONGEST_NAME:
        raise WriteError(
            f"{shown}: a name of {longest} bytes; files and folders may have names of "
            f"{_LONGEST_NAME}, choose a shorter one"
        )
    try:
        path.exists()
    except OSError as error:  # the path as a whole is too long
        raise WriteError(
            f"{shown}: can't write here ({error.strerror or error}), a path of "
            f"{len(os.fsencode(path))} bytes; choose another folder"
        ) from error
    if Path(os.path.realpath(path)).is_symlink():
        raise WriteError(f"{path}: is a link that leads in a circle; remove it")


def _move(partial: Path, target: Path, path: str | Path) -> None:
    """Put a finished file where it belongs."""
    try:
        _sync(partial)
        partial.chmod(_default_mode())
        partial.replace(target)
    except OSError as error:
        raise WriteError(f"{path}: can't be written ({error.strerror or error})") from error
    _sync(target.parent)


def _sync(path: Path) -> None:
    """Flush a file or folder to disk; folders can't be synced on every system."""
    flags = os.O_RDONLY
    try:
        handle = os.open(path, flags)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        if not path.is_dir():
            raise
    finally:
        os.close(handle)


def _default_mode() -> int:
    """The mode a plain `open` would give: mkstemp's 0600 would lock others out."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
