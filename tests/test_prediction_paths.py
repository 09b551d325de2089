"""Odd names and places for what predict reads and writes: nothing lost, one clear line."""

import os
import sys
from pathlib import Path

import laspy
import pytest

from bushseg.errors import BushsegError, WriteError
from bushseg.files import atomic_path
from bushseg.folder_prediction import predict_folder
from bushseg.prediction import predict_file
from bushseg.preparation import prepare

POINTS = 4000


@pytest.fixture
def south(scans) -> Path:
    return scans / "south.las"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(
    "name",
    [
        "Gebüsch 灌木.laz",
        "with space [bold] 100%.laz",
        "-o.laz",
        "n" * 251 + ".laz",
        "ü" * 125 + ".laz",
    ],
    ids=["not ASCII", "special", "dash", "255 bytes", "254 bytes"],
)
def test_any_name(south, model, tmp_path, name):
    deep = tmp_path / "Fläche 灌"
    deep.mkdir()
    scan = deep / f"scan{name[-200:]}"[:100]
    scan = scan.with_name(scan.name.removesuffix(".laz") + ".las")
    scan.write_bytes(south.read_bytes())
    predict_file(scan, tmp_path / "out" / name, model)
    assert len(laspy.read(tmp_path / "out" / name)) == POINTS
    assert names(tmp_path / "out") == [name]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems want names to be Unicode")
def test_a_name_that_is_no_text(south, model, tmp_path):
    name = os.fsdecode(b"caf\xe9.laz")
    scan = tmp_path / os.fsdecode(b"\xff.las")
    scan.write_bytes(south.read_bytes())
    predict_file(scan, tmp_path / "out" / name, model)
    predict_file(tmp_path / "out" / name, tmp_path / "two" / name, model)
    assert names(tmp_path / "two") == [name]
    assert predict_folder(tmp_path / "out", tmp_path / "three", model).complete


@pytest.mark.parametrize("name", ["n" * 252 + ".las", "d" * 256 + "/out.las"])
def test_a_name_that_is_too_long(south, model, tmp_path, name):
    with pytest.raises(WriteError, match=r"a name of 25. bytes; .* names of 255"):
        predict_file(south, tmp_path / "out" / name, model)
    assert not (tmp_path / "out").exists()


def test_a_path_of_many_folders(south, model, tmp_path):
    output = tmp_path.joinpath(*["d" * 200] * 15, "out.las")
    predict_file(south, output, model)
    assert len(laspy.read(output)) == POINTS
    with pytest.raises(WriteError, match="too long"):
        predict_file(south, tmp_path.joinpath(*["d" * 200] * 25, "out.las"), model)


def test_an_output_that_is_a_link(south, model, tmp_path):
    real, link = tmp_path / "real" / "target.las", tmp_path / "link.las"
    real.parent.mkdir()
    real.write_text("old")
    link.symlink_to(real)
    with pytest.raises(WriteError, match="exists already"):
        predict_file(south, link, model)
    predict_file(south, link, model, overwrite=True)
    assert link.is_symlink()
    assert len(laspy.read(real)) == POINTS
    assert names(real.parent) == ["target.las"]


def test_a_link_to_nothing_gets_its_target(south, model, tmp_path):
    (tmp_path / "link.las").symlink_to(tmp_path / "later" / "target.las")
    predict_file(south, tmp_path / "link.las", model)
    assert (tmp_path / "link.las").is_symlink()
    assert names(tmp_path / "later") == ["target.las"]


def test_links_that_go_in_circles(south, model, tmp_path):
    (tmp_path / "a.las").symlink_to(tmp_path / "b.las")
    (tmp_path / "b.las").symlink_to(tmp_path / "a.las")
    with pytest.raises(WriteError, match="leads in a circle"):
        predict_file(south, tmp_path / "a.las", model, overwrite=True)
    with pytest.raises(BushsegError):
        predict_file(tmp_path / "a.las", tmp_path / "out.las", model)
    assert names(tmp_path) == ["a.las", "b.las"]


def test_a_scan_that_is_a_broken_link(model, tmp_path):
    (tmp_path / "scan.las").symlink_to(tmp_path / "nowhere.las")
    with pytest.raises(BushsegError, match=r"scan\.las: no such file"):
        predict_file(tmp_path / "scan.las", tmp_path / "out.las", model)
    assert names(tmp_path) == ["scan.las"]


def test_where_nothing_can_be_written(scans, south, model, tiny, tmp_path):
    """A path below a file: permissions don't bind whoever may do anything."""
    (tmp_path / "file").write_text("no folder")
    for attempt in (
        lambda: predict_file(south, tmp_path / "file" / "out.las", model),
        lambda: predict_folder(scans, tmp_path / "file" / "out", model),
        lambda: prepare([scans], tmp_path / "file" / "data", tiny().prepare),
    ):
        with pytest.raises(WriteError, match=r"can't write here \(Not a directory\)"):
            attempt()
    assert names(tmp_path) == ["file"]


def test_a_folder_that_becomes_read_only(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    def write() -> None:
        with atomic_path(tmp_path / "out.las") as partial:
            partial.write_text("labels")
            monkeypatch.setattr(Path, "replace", refuse)

    with pytest.raises(WriteError, match=r"out\.las: can't be written \(Permission denied\)"):
        write()
    assert names(tmp_path) == []
