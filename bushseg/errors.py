"""What can go wrong, as one tree.

    BushsegError
    ├── ReadError         an input file is missing, truncated, mislabelled or inconsistent
    ├── WriteError        an output can't be written, or would overwrite something
    ├── ConfigError       a setting is unknown, out of range or contradicts another
    ├── SchemeError       a class scheme is unknown or malformed
    ├── CacheError        prepared data is missing, damaged or made by another version
    ├── CheckpointError   a model file is missing, damaged or doesn't fit
    ├── RankError         another process of a training has ended or doesn't answer
    ├── WorkerError       a process that does jobs dies of one, refuses it, or isn't there
    └── DataError         a scan doesn't hold what was asked of it (features, labels, points)

Every message is one line: what was found, what was expected, what to do. The command line prints
it as it stands and exits with status 1.
"""

from pathlib import Path

_LONGEST = 1000  # characters of a message


class BushsegError(Exception):
    """Anything bushseg refuses to do, with the reason and the remedy in its message.

    Messages quote files, which may hold anything: line breaks and a terminal's commands are
    escaped, and what is too long to be read is cut.
    """

    def __init__(self, message: str = "") -> None:
        text = "".join(char if char.isprintable() else repr(char)[1:-1] for char in message)
        super().__init__(text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}...")


class ReadError(BushsegError):
    """An input file can't be read faithfully.

    Args:
        path: The file.
        found: What the file holds.
        expected: What it should hold, and what to do about it.
    """

    def __init__(self, path: str | Path, found: str, expected: str) -> None:
        self.path = Path(path)
        self.found = found
        self.expected = expected
        super().__init__(f"{path}: {found}; expected {expected}")


class WriteError(BushsegError):
    """An output can't be written, or writing it would destroy something."""


class ConfigError(BushsegError):
    """A setting is unknown, out of range or contradicts another."""


class SchemeError(BushsegError):
    """A class scheme is unknown or malformed."""


class CacheError(BushsegError):
    """Prepared data is missing, damaged or made by another version."""


class CheckpointError(BushsegError):
    """A model file is missing, damaged or doesn't fit the data."""


class RankError(BushsegError):
    """Another process of a training has ended or doesn't answer."""


class WorkerError(BushsegError):
    """A process that does jobs dies of one, refuses it, or isn't there."""


class DataError(BushsegError):
    """A scan doesn't hold what was asked of it."""
