import subprocess
import sys
from pathlib import Path

import pytest

from bushseg import io
from bushseg.errors import ReadError, WriteError


def fill(folder: Path, samples: dict[str, bytes]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in samples.items():
        (folder / name).write_bytes(content)


def test_reads_by_suffix(tmp_path: Path, samples: dict[str, bytes], xyz) -> None:
    fill(tmp_path, samples)
    for name in samples:
        assert io.read(tmp_path / name).xyz.tolist() == xyz.tolist(), name


def test_suffix_case_does_not_matter(tmp_path: Path, samples: dict[str, bytes]) -> None:
    (tmp_path / "A.PLY").write_bytes(samples["little.ply"])
    assert len(io.read(str(tmp_path / "A.PLY"))) == 2


@pytest.mark.parametrize(
    ("name", "suffix"),
    [("a.COPC.LAZ", ".copc.laz"), ("a.b.Laz", ".laz"), ("copc.laz", ".laz"), ("scan", "")],
)
def test_suffix_of(name: str, suffix: str) -> None:
    assert io.suffix_of(Path("folder.d") / name) == suffix


def test_open_scan_refuses(tmp_path: Path) -> None:
    for name, message in [("none.ply", "no such file"), ("a.obj", r"'\.obj'"), ("b", "no suffix")]:
        if name != "none.ply":
            (tmp_path / name).write_bytes(b"1 2 3\n")
        with pytest.raises(ReadError, match=message):
            io.open_scan(tmp_path / name)


def test_a_failing_disk_is_a_read_error(
    tmp_path: Path, samples: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.ply").write_bytes(samples["little.ply"])

    def fail(path: Path) -> io.ScanReader:
        raise OSError(5, "Input/output error")

    monkeypatch.setitem(io.READERS, ".ply", fail)
    with pytest.raises(ReadError, match="Input/output error"):
        io.open_scan(tmp_path / "a.ply")


def test_create_refuses(tmp_path: Path, samples: dict[str, bytes]) -> None:
    (tmp_path / "a.ply").write_bytes(samples["little.ply"])
    scan = io.open_scan(tmp_path / "a.ply")
    for suffix, message in [(".copc.laz", "COPC"), (".obj", r"\.obj"), ("", "without a suffix")]:
        with pytest.raises(WriteError, match=message):
            io.create(tmp_path / "out", suffix, scan, {})


def test_label_sidecar(tmp_path: Path, samples: dict[str, bytes]) -> None:
    fill(tmp_path, samples)
    assert io.label_sidecar(tmp_path / "frame.bin") is None
    for name in ("frame.label", "semantic3d.labels", "little.labels"):
        (tmp_path / name).write_bytes(b"1\n2\n")
    assert io.label_sidecar(tmp_path / "frame.bin") == tmp_path / "frame.label"
    assert io.label_sidecar(str(tmp_path / "semantic3d.txt")) == tmp_path / "semantic3d.labels"
    assert io.label_sidecar(tmp_path / "little.ply") is None


def test_find_scans(tmp_path: Path, samples: dict[str, bytes]) -> None:
    fill(tmp_path, samples)
    fill(tmp_path / "b" / "deeper", {"x.bin": b"", "x.label": b"", "notes.txt": b"see above\n"})
    fill(tmp_path / "b", {"metrics.csv": b"epoch,loss\n1,2\n", "site.copc.laz": b""})
    fill(tmp_path / ".cache", {"hidden.ply": b""})
    fill(tmp_path, {".hidden.ply": b"", "semantic3d.labels": b"1\n2\n", "README.md": b"hello\n"})
    expected = [tmp_path / name for name in sorted(samples)]
    expected += [tmp_path / "b" / "site.copc.laz", tmp_path / "b" / "deeper" / "x.bin"]
    assert io.find_scans([tmp_path]) == expected
    first = tmp_path / "little.ply"
    assert io.find_scans([str(first), tmp_path])[0] == first
    assert len(io.find_scans([first, tmp_path])) == len(expected)
    # A file named outright is taken, whatever it looks like.
    notes = tmp_path / "b" / "deeper" / "notes.txt"
    assert io.find_scans([notes]) == [notes]


def test_find_scans_refuses(tmp_path: Path) -> None:
    (tmp_path / "a.md").write_bytes(b"hello\n")
    with pytest.raises(ReadError, match="without scans"):
        io.find_scans([tmp_path])
    with pytest.raises(ReadError, match=r"'\.md'"):
        io.find_scans([tmp_path / "a.md"])
    with pytest.raises(ReadError, match="no such file"):
        io.find_scans([tmp_path / "b.ply"])


def test_a_format_costs_nothing_until_it_is_used() -> None:
    check = (
        "import sys, bushseg.io; "
        "print(sorted({'laspy', 'lazrs', 'pye57', 'scipy', 'open3d', 'torch'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stderr
