"""Waveforms that lie in a file beside a scan: a copy goes beside its output.

A LAS file may keep the full waveforms of its returns in a `.wdp` file of its own name (LAS 1.4 R15,
global encoding, bit 2). Its points say where in it; those of an output say the same, of the file
beside the output.
"""

import filecmp
import shutil
from dataclasses import dataclass
from pathlib import Path

from bushseg.errors import WriteError
from bushseg.files import atomic_path
from bushseg.io.base import ScanInfo


@dataclass(frozen=True, slots=True)
class WaveformCopy:
    """What is to be done about a scan's waveforms.

    Attributes:
        source: The file to copy; None for nothing to do.
        target: Where its copy goes.
        warning: What a user should know, or None.
    """

    source: Path | None
    target: Path
    warning: str | None = None

    @property
    def num_bytes(self) -> int:
        """What the copy will take."""
        return 0 if self.source is None else self.source.stat().st_size

    def write(self) -> None:
        """Copy the file, whole or not at all.

        Raises:
            WriteError: The disk is full, or the file can't be read.
        """
        if self.source is None:
            return
        try:
            with atomic_path(self.target) as partial:
                shutil.copyfile(self.source, partial)
        except OSError as error:
            raise WriteError(
                f"{self.target}: can't copy {self.source} to it ({error.strerror or error})"
            ) from error


def plan_waveforms(info: ScanInfo, output: Path, *, overwrite: bool) -> WaveformCopy:
    """See what has to be copied, before any work is done.

    Args:
        info: The scan.
        output: Its output, LAS or LAZ.
        overwrite: Whether an existing file may be replaced.

    Raises:
        WriteError: The file's place beside the output is taken by another.
    """
    source, target = info.waveforms, output.with_suffix(".wdp")
    if source is None:
        return WaveformCopy(None, target)
    if not source.exists():
        return WaveformCopy(
            None,
            target,
            f"the scan's waveforms are in {source.name}, which isn't beside it; the output's "
            f"points refer to {target.name} in the same way",
        )
    if target.exists():
        # The scan's own file, or a copy that a run left which was stopped before its output stood.
        if target.samefile(source) or filecmp.cmp(source, target, shallow=False):
            return WaveformCopy(None, target)
        if not overwrite:
            raise WriteError(
                f"{target}: exists already, and the waveforms in {source} have to go there; pass "
                "--overwrite to replace it, or name the output otherwise"
            )
    return WaveformCopy(source, target)
