"""What can't be finished isn't begun."""

import errno
import shutil
from collections import namedtuple
from pathlib import Path

import pytest

from bushseg.errors import WriteError
from bushseg.room import check_room, is_full, with_reason


def test_a_disk_with_too_little_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10**12, 0, 3 * 10**9))
    check_room(tmp_path / "new" / "folder", 3e9, "the scan", "write it elsewhere")
    with pytest.raises(
        WriteError, match=r"the scan will take about 3\.01 GB, but 3\.00 GB are free"
    ):
        check_room(tmp_path / "new" / "folder", 3.01e9, "the scan", "write it elsewhere")
    with pytest.raises(WriteError, match="or write it elsewhere"):
        check_room(Path("relative"), 4e9, "the scan", "write it elsewhere")


def test_which_errors_are_a_full_disk_s():
    full = OSError(errno.ENOSPC, "No space left on device")
    outer = WriteError("o.las: can't be written")
    outer.__cause__ = full
    of_rust = WriteError("o.laz: failed (os error 28)")
    for error in (full, outer, of_rust, WriteError(with_reason(str(outer), outer))):
        assert is_full(error)
    assert with_reason(str(of_rust), of_rust).endswith("(No space left on device)")
    assert with_reason(str(full), full) == str(full)
    other = PermissionError(errno.EACCES, "Permission denied")
    assert not is_full(other)
    assert with_reason("no", other) == "no"
