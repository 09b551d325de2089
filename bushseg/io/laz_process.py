"""lazrs at arm's length: a process that decompresses, and may die of a damaged file."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import ReadError
from bushseg.io import laz_worker
from bushseg.io.laz_worker import LENGTH

_LONGEST_TEXT = 1 << 16
_PIPE_BYTES = 1 << 20  # the most that any user may ask of Linux
_UNDAMAGED = "undamaged LAZ data; copy or export the file again"

Process = subprocess.Popen[bytes]


class LazProcess:
    """Answers requests about one file (:mod:`bushseg.io.laz_worker`).

    A process is started when it is needed, once for the chunk table and the first pass over the
    points; a pass begun while another is under way has its own.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._idle: Process | None = None

    def run(self, request: dict[str, Any], most: int) -> Iterator[NDArray[np.uint8]]:
        """Yield the answer's frames.

        Args:
            request: What is asked, but for the file.
            most: Bytes a frame may have.

        Raises:
            ReadError: lazrs refuses the file's bytes, panics, or dies of them.
        """
        process, self._idle = self._idle or _start(self._path), None
        try:
            line = json.dumps({"path": str(self._path.absolute()), **request}).encode() + b"\n"
            stdin, stdout = process.stdin, process.stdout
            assert stdin is not None
            assert stdout is not None
            with suppress(BrokenPipeError):  # it died: that nothing comes back tells
                stdin.write(line)
                stdin.flush()
            while (length := self._length(process, stdout)) > 0:
                if length > most:
                    raise self._refusal("an answer that is too long")
                yield self._take(process, stdout, length)
            if length < 0:
                length = self._length(process, stdout)
                text = self._take(process, stdout, min(max(length, 1), _LONGEST_TEXT)).tobytes()
                raise self._refusal(json.loads(text))
        except BaseException:
            _stop(process)
            raise
        self.close()
        self._idle = process

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """End the process that waits for requests, if there is one."""
        process, self._idle = self._idle, None
        if process is not None:
            _stop(process)

    def _length(self, process: Process, stdout: IO[bytes]) -> int:
        (length,) = LENGTH.unpack(self._take(process, stdout, LENGTH.size).tobytes())
        return int(length)

    def _take(self, process: Process, stdout: IO[bytes], count: int) -> NDArray[np.uint8]:
        """Exactly so many bytes of what it says."""
        data = np.empty(count, np.uint8)
        view = data.data
        while view:
            got = stdout.readinto(view)  # type: ignore[attr-defined]
            if not got:
                status = process.wait()
                reason = f"exit status {status}"
                if status < 0:
                    with suppress(ValueError):
                        reason = signal.Signals(-status).name
                raise self._refusal(f"the decoder died of it, {reason}")
            view = view[got:]
        return data

    def _refusal(self, reason: str | list[str]) -> ReadError:
        if isinstance(reason, list):
            found, expected = reason
            return ReadError(self._path, found, expected)
        found = f"compressed points that don't decode ({reason})"
        return ReadError(self._path, found, _UNDAMAGED)


def _start(path: Path) -> Process:
    spec = find_spec("lazrs")
    if spec is None or spec.origin is None or not sys.executable:
        raise ReadError(path, "compressed points, and no lazrs", "it; run `pip install lazrs`")
    # -I and -S: nothing of the caller's surroundings, so that it starts at once.
    command = [sys.executable, "-I", "-S", laz_worker.__file__, str(Path(spec.origin).parents[1])]
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # panics are told there as well
            bufsize=0,
        )
    except OSError as error:
        raise ReadError(
            path,
            f"compressed points, and no process to decompress them ({error.strerror or error})",
            "a system with memory and processes to spare",
        ) from error
    _widen(process.stdout)
    return process


def _widen(pipe: IO[bytes] | None) -> None:
    """Let a pipe hold more, where the system knows how: fewer turns from process to process."""
    if sys.platform == "linux" and pipe is not None:
        import fcntl

        with suppress(OSError):
            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)


def _stop(process: Process) -> None:
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with suppress(OSError):
                pipe.close()
    process.wait()
