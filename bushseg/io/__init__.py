"""Scans in and out, by suffix.

    with bushseg.io.open_scan("site.laz") as scan:
        for points in scan.chunks():
            ...

A format is one module; :data:`READERS` and :data:`WRITERS` say which. laspy and pye57, which are
slow to import, are imported when such a file is opened and not before.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bushseg.errors import ReadError, WriteError
from bushseg.io.base import ScanInfo, ScanReader, ScanWriter
from bushseg.io.codes import create_label, create_labels, read_codes
from bushseg.io.kitti import find_labels as find_frame_labels
from bushseg.io.kitti import open_kitti
from bushseg.io.pcd import create_pcd, open_pcd
from bushseg.io.ply import create_ply, open_ply
from bushseg.io.sniff import check_file
from bushseg.io.text import create_csv, create_txt, is_points, open_text
from bushseg.io.text import find_labels as find_text_labels
from bushseg.points import PointCloud

__all__ = [
    "READERS",
    "SUFFIXES",
    "WRITERS",
    "ScanInfo",
    "ScanReader",
    "ScanWriter",
    "check_writable",
    "create",
    "find_scans",
    "label_sidecar",
    "open_scan",
    "read",
    "read_codes",
    "suffix_of",
]


def _open_las(path: Path) -> ScanReader:
    from bushseg.io.las import open_las

    return open_las(path)


def _open_e57(path: Path) -> ScanReader:
    from bushseg.io.e57 import open_e57

    return open_e57(path)


def _create_las(path: Path, source: ScanReader, added: Mapping[str, np.dtype[Any]]) -> ScanWriter:
    from bushseg.io.las import create_las

    return create_las(path, source, added)


READERS: dict[str, Callable[[Path], ScanReader]] = {
    ".bin": open_kitti,
    ".copc.laz": _open_las,
    ".csv": open_text,
    ".e57": _open_e57,
    ".las": _open_las,
    ".laz": _open_las,
    ".pcd": open_pcd,
    ".ply": open_ply,
    ".txt": open_text,
    ".xyz": open_text,
}
WRITERS: dict[str, Callable[[Path, ScanReader, Mapping[str, np.dtype[Any]]], ScanWriter]] = {
    ".csv": create_csv,
    ".label": create_label,
    ".labels": create_labels,
    ".las": _create_las,
    ".laz": _create_las,
    ".pcd": create_pcd,
    ".ply": create_ply,
    ".txt": create_txt,
    ".xyz": create_txt,
}
SUFFIXES = tuple(READERS)
"""The suffixes of files that hold points."""


def suffix_of(path: str | Path) -> str:
    """The suffix that decides the format: in lower case, and ".copc.laz" where it is that."""
    name = Path(path).name.lower()
    return ".copc.laz" if name.endswith(".copc.laz") else Path(name).suffix


def open_scan(path: str | Path) -> ScanReader:
    """Open a scan of any known format.

    Returns:
        The reader, a context manager; its header has been read and checked.

    Raises:
        ReadError: The file is missing, of an unknown suffix, mislabelled, truncated or damaged.
    """
    path = Path(path)
    check_file(path)
    opener = _reader_of(path)
    try:
        return opener(path)
    except OSError as error:
        raise ReadError(
            path, f"a read error ({error.strerror or error})", "a readable file; check the disk"
        ) from error


def read(path: str | Path) -> PointCloud:
    """Read a whole scan into memory.

    Raises:
        ReadError: As :func:`open_scan`, or the body is damaged.
    """
    with open_scan(path) as scan:
        return scan.read()


def label_sidecar(path: str | Path) -> Path | None:
    """The file beside a scan that holds its class codes, or None where there is none."""
    path = Path(path)
    reader = READERS.get(suffix_of(path))
    if reader is open_kitti:
        return find_frame_labels(path)
    return find_text_labels(path) if reader is open_text else None


def check_writable(path: str | Path, suffix: str) -> None:
    """Refuse a format that can't be written, before any work is done.

    Args:
        path: The output, for the message.
        suffix: :func:`suffix_of` its name.

    Raises:
        WriteError: It says which formats can be.
    """
    if suffix == ".copc.laz":
        raise WriteError(
            f"{path}: COPC is read but not written; name the output .laz, and index it afterwards"
        )
    if suffix not in WRITERS:
        raise WriteError(
            f"{path}: can't write {suffix or 'a file without a suffix'!r}; choose one of "
            + ", ".join(WRITERS)
        )


def create(
    path: str | Path, suffix: str, source: ScanReader, added: Mapping[str, np.dtype[Any]]
) -> ScanWriter:
    """Create an output for the points of a scan.

    Args:
        path: The file to write, which may be a temporary one.
        suffix: :func:`suffix_of` the output's final name.
        source: The scan being copied.
        added: Names and types of the columns that will be added to it.

    Raises:
        WriteError: The suffix is of no format that can be written.
    """
    check_writable(path, suffix)
    return WRITERS[suffix](Path(path), source, added)


def find_scans(paths: Iterable[str | Path]) -> list[Path]:
    """Expand folders to the scans in them, and check that named files can be scans.

    Folders are searched to any depth, in sorted order, without following links to folders. Hidden
    files and folders are passed over, as are label files and other suffixes. A `.txt` or `.csv`
    found in a folder counts only if it begins like a table of points: notes and metrics lie beside
    scans. A file named outright is always taken.

    Returns:
        Files in the order given, each once however often and by whatever path it was given.

    Raises:
        ReadError: A path doesn't exist, a named file's suffix is unknown, or a folder has no scans.
    """
    found: list[Path] = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = list(_scans_in(path))
            if not inside:
                raise ReadError(path, "a folder without scans", "files of " + ", ".join(SUFFIXES))
            found += inside
        else:
            if not path.exists():
                raise ReadError(path, "no such file", "an existing scan; check the spelling")
            _reader_of(path)
            found.append(path)
    # By what a path leads to: one scan taken for two could both teach and judge.
    unique: dict[Path, Path] = {}
    for path in found:
        unique.setdefault(path.resolve(), path)
    return list(unique.values())


def _reader_of(path: Path) -> Callable[[Path], ScanReader]:
    suffix = suffix_of(path)
    if suffix not in READERS:
        raise ReadError(
            path, f"the suffix {suffix!r}" if suffix else "no suffix", ", ".join(SUFFIXES)
        )
    return READERS[suffix]


def _scans_in(folder: Path) -> Iterator[Path]:
    for root, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = Path(root, name)
            suffix = suffix_of(path)
            if name.startswith(".") or suffix not in READERS:
                continue
            if suffix not in (".txt", ".csv") or is_points(path):
                yield path
