"""The command line, called in a folder of its own."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from bushseg_cli.main import main


@dataclass(frozen=True)
class Outcome:
    """What a command did: exit status, standard output, standard error."""

    status: int
    out: str
    err: str


@pytest.fixture
def bushseg(tmp_path, monkeypatch, capsys) -> Callable[..., Outcome]:
    """Run `bushseg ARGUMENTS` as the installed script would, in a fresh folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr("sys.argv", ["bushseg", *map(str, arguments)])
        capsys.readouterr()
        try:
            main()
            status = 0
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 0
        return Outcome(status, *capsys.readouterr())

    return run


@pytest.fixture
def settings(tiny, tmp_path) -> Path:
    """The tiny network's settings as a file that no command takes unasked."""
    path = tmp_path / "tiny.toml"
    path.write_text(tiny().to_toml())
    return path
