"""A folder that stays while there is something to go on with."""

from contextlib import suppress
from pathlib import Path

import pytest

from bushseg.errors import WriteError
from bushseg.locks import locked
from bushseg.workspace import (
    finished,
    may_be_finished,
    note_finished,
    place_of,
    remove_finished,
    workspace,
)


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
    """What a run leaves that is killed when its output is written, before that is moved."""
    with suppress(KeyboardInterrupt), workspace(output, {"a": 1}) as place:
        place.mkdir()
        (place / "tile").touch()
        partial = output.with_name("partial")
        partial.write_text("labels")
        note_finished(place, partial, {"points": 3})
        raise KeyboardInterrupt
    return place


def test_a_run_killed_when_its_output_stood(tmp_path: Path) -> None:
    output = tmp_path / "out.las"
    assert not may_be_finished(output)
    place = leave(output)
    assert place == place_of(output, {"a": 1})
    assert finished(place, output) is None  # no output: there is something to go on with
    remove_finished(output)
    assert (place / "tile").exists()
    (tmp_path / "partial").rename(output)
    assert may_be_finished(output)
    assert finished(place, output) == {"points": 3}
    assert finished(place_of(output, {"a": 2}), output) is None
    with locked(place.parent):
        remove_finished(output)
        assert (place / "tile").exists()
    remove_finished(output)
    assert list(tmp_path.iterdir()) == [output]
    remove_finished(output)


def test_what_is_to_replace_an_output_stays(tmp_path: Path) -> None:
    output = tmp_path / "out.las"
    output.write_text("older")
    place = leave(output)
    assert not may_be_finished(output)
    remove_finished(output)
    assert (place / "tile").exists()
    with workspace(output, {"a": 1}) as again:
        assert (again / "tile").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.las", "partial"]


def test_a_damaged_note_tells_nothing(tmp_path: Path) -> None:
    output = tmp_path / "out.las"
    place = leave(output)
    (tmp_path / "partial").rename(output)
    (place.parent / f"{place.name}.json").write_text("{")
    assert not may_be_finished(output)
    with workspace(output, {"a": 2}):
        assert not place.exists()
    assert list(tmp_path.iterdir()) == [output]
