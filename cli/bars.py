"""Progress as rich draws it; imported only once a command has something to show."""

from collections.abc import Iterator
from contextlib import contextmanager

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

from .console import shorten


class RateColumn(ProgressColumn):
    """Units done, and units per second: "1.2 M of 3.4 M points, 56 k/s"."""

    def render(self, task: Task) -> Text:
        """Write the column of one task."""
        unit = task.fields["unit"]
        done = shorten(task.completed)
        if task.total is not None:
            done += f" of {shorten(task.total)}"
        speed = task.finished_speed or task.speed
        rate = f", {shorten(speed)}/s" if speed else ""
        return Text(f"{done} {unit}{rate}")


class RichProgress:
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
def bars(*, quiet: bool) -> Iterator[RichProgress]:
    """Progress on standard error: bars on a terminal, lines worth keeping anywhere.

    Args:
        quiet: Show nothing at all.
    """
    # A file may be called "[bold].las" or "site:car:.las": what we print is text, never markup.
    console = Console(
        stderr=True, quiet=quiet, highlight=False, soft_wrap=True, markup=False, emoji=False
    )
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        RateColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=console,
        disable=quiet or not console.is_terminal,
        transient=True,
    ) as drawn:
        yield RichProgress(drawn)
