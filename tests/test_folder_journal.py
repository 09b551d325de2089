"""What counts as done, and what doesn't."""

import json
from pathlib import Path

import pytest

from bushseg.folder_journal import JOURNAL, Journal


@pytest.fixture
def output(tmp_path: Path) -> Path:
    (tmp_path / "a").mkdir()
    return tmp_path / "a" / "x.las"


def is_done(folder: Path, work: str = "w") -> bool:
    return Journal(folder).is_done("a/x.las", work)


def test_done_is_what_was_finished_and_still_is_the_same(tmp_path: Path, output: Path) -> None:
    journal = Journal(tmp_path)
    journal.begin({"a/x.las": "w"})
    assert not is_done(tmp_path)
    output.write_text("labels")
    journal.finish("a/x.las", "w")
    assert is_done(tmp_path)
    assert not is_done(tmp_path, "other model")
    output.write_text("edited")
    assert not is_done(tmp_path)
    output.unlink()
    assert not is_done(tmp_path)


def test_killed_between_the_output_and_the_note(tmp_path: Path, output: Path) -> None:
    Journal(tmp_path).begin({"a/x.las": "w"})
    output.write_text("labels")
    assert is_done(tmp_path)
    assert not is_done(tmp_path, "other model")


def test_killed_before_an_old_output_was_replaced(tmp_path: Path, output: Path) -> None:
    output.write_text("old")
    Journal(tmp_path).begin({"a/x.las": "w"})
    assert not is_done(tmp_path)
    output.write_text("new ones")
    assert is_done(tmp_path)


def test_killed_while_the_journal_was_written(tmp_path: Path, output: Path) -> None:
    Journal(tmp_path).begin({"a/x.las": "w"})
    (tmp_path / "..bushseg-__e_6k1b.partial.json").write_text("{")
    Journal(tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == [JOURNAL]


def test_what_is_forgotten(tmp_path: Path, output: Path) -> None:
    journal = Journal(tmp_path)
    output.write_text("labels")
    journal.finish("a/x.las", "w")
    journal.forget("a/x.las")
    assert not is_done(tmp_path)


def test_a_folder_may_be_moved(tmp_path: Path, output: Path) -> None:
    output.write_text("labels")
    Journal(tmp_path).finish("a/x.las", "w")
    (tmp_path / "a").rename(tmp_path / "b")
    (tmp_path / "moved").mkdir()
    (tmp_path / "b").rename(tmp_path / "moved" / "a")
    (tmp_path / JOURNAL).rename(tmp_path / "moved" / JOURNAL)
    assert is_done(tmp_path / "moved")


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"version": 0}', '{"outputs": {"a": 1}}', '{"outputs": {"a": {}}}']
)
def test_a_damaged_journal_knows_nothing(tmp_path: Path, output: Path, text: str) -> None:
    output.write_text("labels")
    Journal(tmp_path).finish("a/x.las", "w")
    version = json.loads((tmp_path / JOURNAL).read_text())["version"]
    (tmp_path / JOURNAL).write_text(text.replace('{"outputs', f'{{"version": {version}, "outputs'))
    assert not is_done(tmp_path)
