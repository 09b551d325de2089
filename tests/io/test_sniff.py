import os
from pathlib import Path

import pytest

from bushseg.errors import ReadError
from bushseg.io.sniff import check_file


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "empty"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n", "Git-LFS pointer"),
        (b"\n  <!DOCTYPE html><html>404</html>", "web page"),
        (b"\xef\xbb\xbf<html>", "web page"),
        (b"<?xml version='1.0'?><Error>AccessDenied</Error>", "web page"),
        (b"\x1f\x8b\x08\x00rest", "gzip"),
        (b"PK\x03\x04rest", "zip archive"),
    ],
)
def test_refuses_what_is_not_a_scan(tmp_path: Path, content: bytes, found: str) -> None:
    path = tmp_path / "scan.laz"
    path.write_bytes(content)
    with pytest.raises(ReadError, match=found) as caught:
        check_file(path)
    assert "\n" not in str(caught.value)


def test_refuses_missing_folder_and_pipe(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match="no such file"):
        check_file(tmp_path / "none.laz")
    with pytest.raises(ReadError, match="a folder"):
        check_file(tmp_path)
    pipe = tmp_path / "pipe.bin"
    os.mkfifo(pipe)
    with pytest.raises(ReadError, match="pipe"):
        check_file(pipe)


def test_lets_scans_pass(tmp_path: Path) -> None:
    path = tmp_path / "scan.txt"
    path.write_bytes(b"0 0 0\n")
    check_file(path)
