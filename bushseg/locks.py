"""One process at a time in a folder.

The lock is the operating system's, on an open file: it ends with the process that holds it, however
that process ends. A lock file that is left behind locks nothing.
"""

import errno
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bushseg.errors import WriteError

LOCK = ".lock"

_TICK = 0.1  # seconds between two tries

_HELD = {errno.EACCES, errno.EAGAIN, errno.EDEADLK}
"""What the system says of a lock that another process holds."""


@contextmanager
def locked(folder: str | Path, name: str = LOCK, patience: float = 0.0) -> Iterator[None]:
    """Keep other processes out of a folder, as far as they ask for the same lock.

    A file system that knows no locks (some network ones) can't keep anybody out: there the block
    runs unlocked.

    Args:
        folder: The folder; created if need be, and removed again if the block leaves it empty.
        name: The lock file's name in it; removed when the block ends.
        patience: Seconds to wait for another process that holds the lock.

    Raises:
        WriteError: Another process holds the lock, or the folder can't be created or written to.
    """
    folder = Path(folder)
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        deadline = time.monotonic() + patience
        while (handle := _take(folder / name)) is None and time.monotonic() < deadline:
            time.sleep(_TICK)
    except OSError as error:
        raise WriteError(f"{folder}: can't write here ({error.strerror or error})") from error
    if handle is None:
        raise WriteError(
            f"{folder}: {_holder(folder / name)} is at work here; wait until it has ended, stop "
            "it, or name another folder"
        )
    try:
        with suppress(OSError):  # a full disk holds a lock as well as any
            os.truncate(handle, 0)
            os.write(handle, f"{os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        # Removed while it is still held: nobody who comes now takes a file that is about to go.
        with suppress(OSError):
            (folder / name).unlink()
            if is_new:
                folder.rmdir()  # fails where something stands in it
        os.close(handle)


def _take(path: Path) -> int | None:
    """Open and lock a file; None where another process holds it."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(handle)
            with suppress(FileNotFoundError):
                # Its holder may have removed it between our opening and our locking it.
                if os.path.samestat(path.stat(), os.fstat(handle)):
                    return handle
        except OSError as error:
            if error.errno not in _HELD:
                return handle
            os.close(handle)
            return None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _lock(handle: int) -> None:
    """Lock an open file, or raise OSError at once."""
    if sys.platform == "win32":
        import msvcrt

        # A byte far behind what is written, which others may then still read.
        os.lseek(handle, 2**30, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        os.lseek(handle, 0, os.SEEK_SET)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _holder(path: Path) -> str:
    """Who holds a lock, as its file says."""
    try:
        written = path.read_text(encoding="utf-8", errors="replace")[:100]
    except OSError:
        written = ""
    return (
        f"another process ({written})" if written.isprintable() and written else "another process"
    )
