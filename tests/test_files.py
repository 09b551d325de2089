"""Outputs appear whole or not at all, and destroy nothing they were not meant to."""

import os
import stat
from pathlib import Path

import pytest

from bushseg.errors import WriteError
from bushseg.files import atomic_path, check_output, remove_partials, remove_partials_in


def write_half(target: Path, error: type[BaseException], *, remove: bool) -> None:
    with atomic_path(target) as partial:
        partial.write_text("half")
        if remove:
            partial.unlink()
        raise error("half way")


def test_a_file_appears_with_its_folder_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "new" / "deep" / "out.las"
    with atomic_path(target) as partial:
        assert partial.suffix == ".las"
        assert partial.parent == target.parent
        partial.write_text("whole")
        assert not target.exists()
    assert target.read_text() == "whole"
    assert [path.name for path in target.parent.iterdir()] == ["out.las"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    target = tmp_path / "out.ply"
    target.write_text("old")
    with pytest.raises(error):
        write_half(target, error, remove=False)
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out.ply"]


def test_a_failure_may_have_removed_its_own_partial_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="half way"):
        write_half(tmp_path / "out.ply", ValueError, remove=True)
    assert not list(tmp_path.iterdir())


def test_a_link_stays_and_its_target_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    real, link = tmp_path / "real" / "out.txt", tmp_path / "out.txt"
    real.write_text("old")
    link.symlink_to(real)
    with atomic_path(link) as partial:
        partial.write_text("new")
    assert link.is_symlink()
    assert real.read_text() == "new"


def test_others_may_read_as_after_a_plain_open(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        with atomic_path(tmp_path / "out.txt") as partial:
            partial.write_text("x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "out.txt").stat().st_mode) == 0o640


def test_a_long_name_is_no_obstacle(tmp_path: Path) -> None:
    target = tmp_path / ("n" * 240 + ".las")
    with atomic_path(target) as partial:
        partial.write_text("x")
    assert target.exists()


def test_a_folder_that_cannot_be_is_a_write_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(WriteError, match="can't write here"), atomic_path(tmp_path / "file" / "x"):
        pass


def test_an_output_is_checked_before_any_work(tmp_path: Path) -> None:
    old = tmp_path / "old.las"
    old.write_text("x")
    with pytest.raises(WriteError, match="is a folder"):
        check_output(tmp_path, overwrite=True)
    with pytest.raises(WriteError, match="--overwrite"):
        check_output(old, overwrite=False)
    check_output(old, overwrite=True)
    check_output(tmp_path / "new.las", (old,), overwrite=False)
    check_output(old, (tmp_path / "missing.las",), overwrite=True)


@pytest.mark.parametrize("kind", ["itself", "relative", "symbolic", "hard"])
def test_the_input_is_never_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    source = tmp_path / "scan.las"
    source.write_text("x")
    monkeypatch.chdir(tmp_path)
    output = {"itself": source, "relative": Path("scan.las")}.get(kind, tmp_path / "link.las")
    if kind == "symbolic":
        output.symlink_to(source)
    elif kind == "hard":
        output.hardlink_to(source)
    with pytest.raises(WriteError, match="the input itself"):
        check_output(output, (source,), overwrite=True)


def test_what_killed_processes_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "out.las"
    killed = atomic_path(target)
    left = killed.__enter__()
    others = [".out-12345678.partial.ply", ".out-1.partial.las", "out.las", ".other-12345678.las"]
    for name in others:
        (tmp_path / name).touch()
    remove_partials(target)
    assert not left.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(others)
    remove_partials(tmp_path / "nowhere" / "out.las")


def test_partial_files_of_a_whole_folder(tmp_path: Path) -> None:
    names = (
        ".a-abcd1234.partial.las",
        ".tile_0003-_2z4efgh.partial.safetensors",
        ".a-x_y_z_12.partial",
    )
    left = [tmp_path / name for name in names]
    others = [tmp_path / name for name in ("a.las", ".a-12345678.las", "a-12345678.partial.las")]
    for path in (*left, *others):
        path.touch()
    remove_partials_in(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(others)
    remove_partials_in(tmp_path / "nowhere")
