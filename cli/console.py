"""What every command shares: results on standard output, all else on standard error."""

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text


def _console(*, stderr: bool, quiet: bool = False) -> Console:
    # A file may be called "[bold].las" or "site:car:.las": what we print is text, never markup.
    return Console(
        stderr=stderr, quiet=quiet, highlight=False, soft_wrap=True, markup=False, emoji=False
    )


out = _console(stderr=False)
err = _console(stderr=True)


class _RateColumn(ProgressColumn):
    """Units done, and units per second: "1.2 M of 3.4 M points, 56 k/s"."""

    def render(self, task: Task) -> Text:
        unit = task.fields["unit"]
        done = shorten(task.completed)
        if task.total is not None:
            done += f" of {shorten(task.total)}"
        speed = task.finished_speed or task.speed
        rate = f", {shorten(speed)}/s" if speed else ""
        return Text(f"{done} {unit}{rate}")


class _RichProgress:
    """bushseg's progress, drawn by rich."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task: TaskID | None = None

    def start(self, stage: str, total: int | None, unit: str) -> None:
        """Replace the stage that is shown."""
        if self._task is not None:
            self._progress.remove_task(self._task)
        self._task = self._progress.add_task(stage, total=total, unit=unit)

    def advance(self, amount: int) -> None:
        """Move the bar."""
        if self._task is not None:
            self._progress.advance(self._task, amount)

    def note(self, message: str) -> None:
        """Print a line that stays."""
        self._progress.console.print(message)


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[_RichProgress]:
    """Progress on standard error: bars on a terminal, lines worth keeping anywhere.

    Args:
        quiet: Show nothing at all.
    """
    console = _console(stderr=True, quiet=quiet)
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        _RateColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console,
        disable=quiet or not console.is_terminal,
        transient=True,
    ) as drawn:
        yield _RichProgress(drawn)


def shorten(value: float) -> str:
    """A count in at most four characters and a unit: 950, 12.3 k, 4.56 M."""
    for unit in ("", " k", " M"):
        if value < 999.5:
            digits = 0 if not unit or value >= 99.95 else 1
            return f"{value:.{digits}f}{unit}"
        value /= 1000
    return f"{value:.1f} G"


def print_json(result: Any) -> None:
    """Print a result for machines: one JSON object; NaN becomes null."""
    out.print(json.dumps(_plain(result), indent=1))


def warn(messages: tuple[str, ...] | list[str]) -> None:
    """Print warnings, a line each, on standard error."""
    for message in messages:
        err.print(f"warning: {message}", style="yellow")


def _plain(value: Any) -> Any:
    """What JSON can hold."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {field.name: _plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
