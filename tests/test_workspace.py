"""A folder that stays while there is something to go on with."""

import os
from contextlib import suppress
from pathlib import Path

import pytest

from bushseg.errors import WriteError
from bushseg.locks import locked
from bushseg.workspace import remove_finished, workspace


def test_nothing_is_left_of_a_run_that_ended_well(tmp_path: Path) -> None:
    with workspace(tmp_path / "out.las", {"a": 1}) as place:
        assert not place.exists()
        place.mkdir()
        (place / "tile").write_text("x")
    assert list(tmp_path.iterdir()) == []


def test_what_a_failed_run_left_is_found_by_the_next_of_the_same_kind(tmp_path: Path) -> None:
    output = tmp_path / "out.las"

    def fail(identity: dict[str, int]) -> bool:
        try:
            with workspace(output, identity) as place:
                found = (place / "tile").exists()
                place.mkdir(exist_ok=True)
                (place / "tile").write_text("x")
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            return found

    assert not fail({"a": 1})
    assert fail({"a": 1})
    assert not fail({"a": 2})  # and so the other's is removed
    assert not fail({"a": 1})
    with workspace(output, {"a": 1}):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_fails_with_nothing_done_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no"), workspace(tmp_path / "out.las", {}):
        raise ValueError("no")
    assert list(tmp_path.iterdir()) == []


def test_another_process_has_to_wait(tmp_path: Path) -> None:
    with workspace(tmp_path / "out.las", {}):
        with (
            pytest.raises(WriteError, match="is at work here"),
            workspace(tmp_path / "out.las", {"a": 1}),
        ):
            pass
        with workspace(tmp_path / "out.laz", {}):
            pass


def test_a_folder_elsewhere_and_long_names(tmp_path: Path) -> None:
    output = tmp_path / ("ü" * 100 + ".las")
    with workspace(output, {}, tmp_path / "scratch") as place:
        place.mkdir()
        assert (tmp_path / "scratch") in place.parents


def leave(output: Path) -> Path:
    """What a killed run leaves."""
    with suppress(KeyboardInterrupt), workspace(output, {}) as place:
        place.mkdir()
        (place / "tile").touch()
        raise KeyboardInterrupt
    return place / "tile"


def test_a_run_killed_after_its_output_was_done(tmp_path: Path) -> None:
    output = tmp_path / "out.las"
    tile = leave(output)
    remove_finished(output)
    assert tile.exists()  # no output: there is something to go on with
    output.touch()
    os.utime(tile, ns=(0, output.stat().st_mtime_ns - 1))
    with locked(tile.parents[1]):
        remove_finished(output)
        assert tile.exists()
    remove_finished(output)
    assert list(tmp_path.iterdir()) == [output]
    remove_finished(output)


def test_what_is_newer_than_the_output_is_to_replace_it(tmp_path: Path) -> None:
    output = tmp_path / "out.las"
    output.touch()
    tile = leave(output)
    os.utime(tile, ns=(0, output.stat().st_mtime_ns + 1))
    remove_finished(output)
    assert tile.exists()
