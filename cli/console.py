"""What every command shares: results on standard output, all else on standard error."""

import dataclasses
import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

from bushseg.progress import Progress

_INTERRUPTED = 130
"""Exit status of a command that Ctrl-C ended, as shells count it."""


class _Lines:
    """Lines of text as it stands: a file may be called "[bold].las", so nothing is markup."""

    def __init__(self, *, stderr: bool) -> None:
        self._stderr = stderr

    def print(self, text: str, style: str | None = None) -> None:
        """Print a line, in a color on a terminal that isn't asked to do without."""
        if style is not None and not os.environ.get("NO_COLOR"):
            text = typer.style(text, fg=style)
        typer.echo(text, err=self._stderr)


out = _Lines(stderr=False)
err = _Lines(stderr=True)


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[Progress]:
    """Progress on standard error: bars on a terminal, lines worth keeping anywhere.

    Args:
        quiet: Show nothing at all.
    """
    from .bars import bars  # not before there is something to show: rich takes long to import

    with bars(quiet=quiet) as shown:
        yield shown


@contextmanager
def interruptible() -> Iterator[None]:
    """Say after Ctrl-C that nothing is lost."""
    try:
        yield
    except KeyboardInterrupt:
        err.print("interrupted; what is done is kept, and the same command goes on from there")
        raise typer.Exit(_INTERRUPTED) from None


def shorten(value: float) -> str:
    """A count in at most four characters and a unit: 950, 12.3 k, 4.56 M."""
    for unit in ("", " k", " M"):
        if value < 999.5:
            digits = 0 if not unit or value >= 99.95 else 1
            return f"{value:.{digits}f}{unit}"
        value /= 1000
    return f"{value:.1f} G"


def print_stages(stages: Mapping[str, float], seconds: float) -> None:
    """Print where the time went: a line a stage, and what lies between them."""
    for stage, spent in {**stages, "other": seconds - sum(stages.values())}.items():
        out.print(f"  {stage:24} {spent:>10.3f} s {spent / max(seconds, 1e-9):6.1%}")


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
