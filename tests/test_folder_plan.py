"""Outputs have the scans' places and names, and none falls on another or on a scan."""

from pathlib import Path

import pytest

from bushseg.errors import ReadError, WriteError
from bushseg.folder_plan import plan_folder


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    for name in ("a/x.las", "a/b/y.copc.laz", "z.PLY", "a/.hidden.las", "notes.md"):
        path = tmp_path / "scans" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path / "scans"


def names(*arguments: object) -> list[str]:
    return [it.name for it in plan_folder(*arguments)]


def test_places_and_names_are_mirrored(scans: Path, tmp_path: Path) -> None:
    planned = plan_folder([scans], tmp_path / "out")
    assert [it.name for it in planned] == ["z.PLY", "a/x.las", "a/b/y.laz"]
    assert [it.output for it in planned] == [tmp_path / "out" / it.name for it in planned]
    assert planned[1].scan == scans / "a" / "x.las"


@pytest.mark.parametrize(
    ("name", "output"),
    [("a.e57", "a.las"), ("a.bin", "a.label"), ("a.b.XYZ", "a.b.XYZ"), ("a.COPC.LAZ", "a.laz")],
)
def test_what_is_read_but_not_written_gets_a_substitute(
    tmp_path: Path, name: str, output: str
) -> None:
    (tmp_path / name).touch()
    assert names([tmp_path / name], tmp_path / "out") == [output]


@pytest.mark.parametrize("suffix", [".laz", "laz", ".LAZ"])
def test_a_suffix_for_all(scans: Path, tmp_path: Path, suffix: str) -> None:
    assert names([scans], tmp_path / "out", suffix) == ["z.laz", "a/x.laz", "a/b/y.laz"]


@pytest.mark.parametrize("suffix", [".e57", "docx", ".copc.laz"])
def test_a_suffix_that_can_t_be_written(scans: Path, tmp_path: Path, suffix: str) -> None:
    with pytest.raises(WriteError, match=r"written|write"):
        plan_folder([scans], tmp_path / "out", suffix)


def test_scans_named_themselves_come_to_the_top_and_count_once(scans: Path, tmp_path: Path) -> None:
    given = [scans / "a" / "x.las", scans / "a"]
    assert names(given, tmp_path / "out") == ["x.las", "b/y.laz"]


def test_earlier_outputs_are_no_scans(scans: Path) -> None:
    output = scans / "labeled"
    output.mkdir()
    (output / "x.las").touch()
    assert names([scans], output) == ["z.PLY", "a/x.las", "a/b/y.laz"]
    assert names([output / "x.las"], scans / "again") == ["x.las"]


def test_a_folder_with_nothing_but_outputs(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "x.las").touch()
    with pytest.raises(ReadError, match="no scans but those in"):
        plan_folder([tmp_path], tmp_path / "out")


def test_an_output_folder_above_the_scans(scans: Path, tmp_path: Path) -> None:
    assert names([scans], tmp_path) == ["z.PLY", "a/x.las", "a/b/y.laz"]


def test_two_scans_for_one_output(scans: Path, tmp_path: Path) -> None:
    (scans / "a" / "x.laz").touch()
    plan_folder([scans], tmp_path / "out")
    with pytest.raises(WriteError, match=r"x\.las and .*x\.laz would both become .*x\.ply"):
        plan_folder([scans], tmp_path / "out", ".ply")
    other = tmp_path / "other"
    other.mkdir()
    (other / "z.PLY").touch()
    with pytest.raises(WriteError, match="would both become"):
        plan_folder([scans, other], tmp_path / "out")


def test_the_scans_are_never_the_outputs(scans: Path, tmp_path: Path) -> None:
    with pytest.raises(WriteError, match="folder of the scans"):
        plan_folder([scans], scans / "a" / "..")
    with pytest.raises(WriteError, match="an input itself"):
        plan_folder([scans / "z.PLY"], scans)
    (tmp_path / "link").symlink_to(scans)
    with pytest.raises(WriteError, match="folder of the scans"):
        plan_folder([scans], tmp_path / "link")


def test_true_labels_beside_a_frame_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "f.bin").touch()
    (tmp_path / "f.label").touch()
    with pytest.raises(WriteError, match="an input itself"):
        plan_folder([tmp_path / "f.bin"], tmp_path)


def test_an_output_folder_that_is_a_file(scans: Path) -> None:
    with pytest.raises(WriteError, match="is a file"):
        plan_folder([scans], scans / "z.PLY")
