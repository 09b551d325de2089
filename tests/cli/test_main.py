import io
import subprocess
import sys
from pathlib import Path

import pytest
from bushseg_cli import console

COMMANDS = (
    "info",
    "prepare",
    "train",
    "predict",
    "verify",
    "evaluate",
    "simulate",
    "labels",
    "models",
    "render",
)

SLOW_TO_IMPORT = (
    "laspy",
    "matplotlib",
    "numba",
    "numpy",
    "open3d",
    "pydantic",
    "rich",
    "scipy",
    "torch",
)


def test_help_names_every_command(bushseg):
    outcome = bushseg("--help")
    assert outcome.status == 0
    assert all(command in outcome.out for command in (*COMMANDS, "config"))


@pytest.mark.parametrize("command", [*COMMANDS, "config"])
def test_every_command_has_help_with_an_example(bushseg, command):
    outcome = bushseg(command, "--help")
    assert outcome.status == 0
    assert f"bushseg {command}" in outcome.out
    assert "Examples" in outcome.out
    assert bushseg(command, "-h").out == outcome.out


def test_help_cuts_no_description_short(bushseg, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert "..." not in bushseg("--help").out.partition("Commands:")[2]


def test_help_loads_nothing_that_takes_long():
    script = Path(sys.executable).with_name("bushseg")
    result = subprocess.run(
        [sys.executable, "-X", "importtime", script, "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = {line.rpartition("|")[2].strip() for line in result.stderr.splitlines()}
    assert "bushseg_cli.main" in loaded
    assert not loaded & set(SLOW_TO_IMPORT)


def test_version(bushseg):
    assert bushseg("--version").out.startswith("bushseg 0.")


@pytest.mark.parametrize(
    "arguments",
    [
        ["grow"],
        ["predict"],
        ["predict", "a.las"],
        ["train", "--epochs", "many"],
        ["train", "--resume", "runs/a", "--run", "runs/b"],
        ["train", "--resume", "runs/a", "--overwrite"],
        ["predict", "a.las", "-o", "b.las", "--asprs", "bush"],
        ["predict", "a.las", "-o", "b.las", "--asprs", "bush=²"],
        ["labels", "--colour"],
    ],
)
def test_a_wrong_call_is_status_2(bushseg, arguments):
    outcome = bushseg(*arguments)
    assert outcome.status == 2
    assert outcome.out == ""
    assert "Usage" in outcome.err


@pytest.mark.parametrize(
    "arguments",
    [
        ["info", "none.las"],
        ["prepare", "none"],
        ["train", "none"],
        ["train", "--resume", "none"],
        ["predict", "none.las", "-o", "out.las"],
        ["predict", "none.las", "-o", "out.las", "-m", "none.safetensors"],
        ["verify", "none.las", "out.las"],
        ["evaluate", "none.las", "--scheme", "bush"],
        ["evaluate", "none.las", "--scheme", "shrubs"],
        ["simulate", "-o", "out", "--size", "-3"],
        ["simulate", "-o", "out", "--sensor", "sonar"],
        ["labels", "shrubs"],
        ["models", "--model", "none.safetensors"],
        ["config", "-c", "none.toml"],
        ["train", "--epochs", "0"],
        ["prepare", "none", "--voxel-size", "nan"],
    ],
)
def test_an_error_is_status_1_and_one_line(bushseg, arguments):
    outcome = bushseg(*arguments)
    assert outcome.status == 1
    assert outcome.out == ""
    assert outcome.err.startswith("error: ")
    assert outcome.err.count("\n") == 1


def test_out_of_memory_says_what_to_do(bushseg, monkeypatch):
    def fail(*args, **kwargs):
        raise MemoryError

    monkeypatch.setattr("bushseg.io.find_scans", fail)
    outcome = bushseg("info", "a.las")
    assert outcome.status == 1
    assert "voxel_size" in outcome.err


def test_a_failing_disk_is_one_line(bushseg, monkeypatch):
    def fail(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bushseg.io.find_scans", fail)
    outcome = bushseg("info", "a.las")
    assert outcome.status == 1
    assert outcome.err.startswith("error: ")
    assert "No space left on device" in outcome.err
    assert outcome.err.count("\n") == 1


@pytest.mark.parametrize("stream", ["out", "err"])
def test_colors_are_for_terminals_that_want_them(stream, monkeypatch, capsys):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    def printed(stream_type: type[io.StringIO]) -> str:
        monkeypatch.setattr(f"sys.std{stream}", stream_type())
        getattr(console, stream).print("[bold] :car:", style="red")
        return getattr(sys, f"std{stream}").getvalue()

    monkeypatch.delenv("NO_COLOR", raising=False)
    assert printed(Terminal) == "\x1b[31m[bold] :car:\x1b[0m\n"
    assert printed(io.StringIO) == "[bold] :car:\n"
    monkeypatch.setenv("NO_COLOR", "1")
    assert printed(Terminal) == "[bold] :car:\n"


def test_file_names_are_no_markup(bushseg):
    """As markup, [bold] would vanish and [/bold] end in a traceback; :car: would be a picture."""
    name = "a[bold] [/bold]:car:.csv"
    Path(name).parent.mkdir()
    Path(name).write_text("x,y,z\n0,0,0\n1,1,1\n")
    assert bushseg("info", name).out.startswith(f"{name}: ")
    outcome = bushseg("render", name, "-o", f"{name}.png", "--color", "height")
    assert (outcome.status, outcome.out) == (0, f"{name}.png\n")
    assert f"error: {name}.png" in bushseg("render", name, "-o", f"{name}.png").err


def test_the_installed_script(tmp_path):
    script = Path(sys.executable).with_name("bushseg")
    result = subprocess.run(
        [script, "info", "none.las"], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.startswith("error: none.las: no such file")
    assert "Traceback" not in result.stderr
