"""Which output each of many scans gets: the scans' own folders and names, mirrored."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from bushseg import io
from bushseg.errors import ReadError, WriteError

SUBSTITUTES = {".copc.laz": ".laz", ".e57": ".las", ".bin": ".label"}
"""What stands in for a format that is read and not written."""


@dataclass(frozen=True, slots=True)
class Planned:
    """One scan to be labelled.

    Attributes:
        scan: The scan.
        name: Its output's path within the output folder, with "/" between its parts.
        output: The output.
    """

    scan: Path
    name: str
    output: Path


def plan_folder(
    paths: Iterable[str | Path], output: str | Path, suffix: str | None = None
) -> list[Planned]:
    """Find scans and name their outputs.

    A scan at `a/b.laz` below a folder that was given goes to `a/b.laz` below the output folder, a
    scan that was named itself to its name there. The suffix stays, or becomes that of
    :data:`SUBSTITUTES`, or the one that is asked for. Scans in the output folder, where that lies
    within an input folder, are earlier outputs and passed over.

    Args:
        paths: Scans, or folders that are searched for them (:func:`bushseg.io.find_scans`).
        output: The folder for the outputs; it need not exist.
        suffix: The suffix of all outputs, such as ".laz"; None: each scan's own.

    Returns:
        What is to be done, in order; each scan once.

    Raises:
        ReadError: A path doesn't exist or a folder has no scans.
        WriteError: Outputs would fall on each other or on an input, `output` is a file or an input
            folder itself, or the suffix can't be written.
    """
    folder = Path(output)
    if folder.exists() and not folder.is_dir():
        raise WriteError(f"{folder}: is a file; the outputs of several scans need a folder")
    if suffix is not None:
        suffix = suffix.lower() if suffix.startswith(".") else f".{suffix.lower()}"
        io.check_writable(folder / f"*{suffix}", suffix)
    planned: dict[Path, Planned] = {}
    for path in map(Path, paths):
        if path.is_dir() and path.resolve() == folder.resolve():
            raise WriteError(f"{folder}: is the folder of the scans; name another for the outputs")
        for scan in _scans_in(path, folder):
            name = scan.relative_to(path) if path.is_dir() else Path(scan.name)
            name = name.with_name(_output_name(name.name, suffix))
            planned.setdefault(scan.resolve(), Planned(scan, name.as_posix(), folder / name))
    _refuse_clashes(list(planned.values()))
    return list(planned.values())


def _scans_in(path: Path, folder: Path) -> list[Path]:
    """A path's scans, without those that an earlier run put into the output folder within it."""
    scans, within = io.find_scans([path]), folder.resolve()
    if path.is_dir() and within.is_relative_to(path.resolve()):
        scans = [scan for scan in scans if not _is_in(scan, within)]
        if not scans:
            raise ReadError(
                path, f"no scans but those in {folder}", "files of " + ", ".join(io.SUFFIXES)
            )
    return scans


def _is_in(scan: Path, folder: Path) -> bool:
    # Where it stands counts, not what it may be a link to.
    return scan.parent.resolve().is_relative_to(folder)


def _output_name(name: str, suffix: str | None) -> str:
    own = io.suffix_of(name)
    wanted = suffix or SUBSTITUTES.get(own)
    return name if wanted is None or wanted == own else name[: len(name) - len(own)] + wanted


def _refuse_clashes(planned: Sequence[Planned]) -> None:
    """Two scans for one output, and an output that is an input or its labels."""
    by_name: dict[str, Path] = {}
    inputs = {it.scan.resolve() for it in planned}
    inputs |= {found.resolve() for it in planned if (found := io.label_sidecar(it.scan))}
    for it in planned:
        # Names that differ by case alone are one name on some systems' disks.
        other = by_name.setdefault(os.path.normcase(it.name), it.scan)
        if other != it.scan:
            raise WriteError(
                f"{other} and {it.scan} would both become {it.output}; label them one after the "
                "other, into folders of their own"
            )
        if it.output.resolve() in inputs:
            raise WriteError(
                f"{it.output}: is an input itself; name another folder for the outputs"
            )
