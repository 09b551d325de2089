"""What a file turns out to be, whatever its name says.

Scans are often not what their suffix claims: a Git-LFS pointer from a clone without LFS, an error
page saved by a download, an archive. Every reader is preceded by :func:`check_file`, so that none
of these is ever parsed as points.
"""

import re
from pathlib import Path

from bushseg.errors import ReadError

_HEAD_BYTES = 512
_HTML = re.compile(rb"<(!doctype\s+html|html|head|body|\?xml)\b", re.IGNORECASE)
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
# Signatures no scan begins with, and what to do about the file that has one.
_ARCHIVES = {
    b"\x1f\x8b": ("a gzip file", "gunzip"),
    b"PK\x03\x04": ("a zip archive", "unzip"),
    b"7z\xbc\xaf\x27\x1c": ("a 7-Zip archive", "7z x"),
    b"BZh": ("a bzip2 file", "bunzip2"),
    b"\xfd7zXZ\x00": ("an xz file", "unxz"),
    b"\x28\xb5\x2f\xfd": ("a Zstandard file", "unzstd"),
    b"Rar!\x1a\x07": ("a RAR archive", "unrar x"),
}


def check_file(path: Path) -> None:
    """Refuse what can't be a scan, before a reader sees it.

    Raises:
        ReadError: The file is missing, a folder, not a regular file, unreadable, empty, a Git-LFS
            pointer, an HTML or XML page, or an archive.
    """
    if path.is_dir():
        raise ReadError(path, "a folder", "a scan file; name a file inside it")
    if not path.exists():
        raise ReadError(path, "no such file", "an existing scan; check the spelling")
    if not path.is_file():
        # Opening a pipe or a device could block for ever.
        raise ReadError(path, "a pipe or device", "a regular file; save the data to one first")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ReadError(path, f"unreadable ({reason})", "a file you may read") from error
    if not head:
        raise ReadError(path, "an empty file (0 bytes)", "points; copy or download it again")
    if head.startswith(b"version https://git-lfs"):
        raise ReadError(path, "a Git-LFS pointer, not the data", "the scan; run `git lfs pull`")
    for signature, (kind, command) in _ARCHIVES.items():
        if head.startswith(signature):
            raise ReadError(path, kind, f"a scan; unpack it first (`{command} {path.name}`)")
    if _HTML.match(head.removeprefix(_BYTE_ORDER_MARK).lstrip()):
        raise ReadError(
            path, "a web page (HTML or XML)", "a scan; the download failed, fetch it again"
        )
