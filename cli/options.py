"""Options that several commands have."""

from pathlib import Path
from typing import Annotated, Any

import typer

ConfigFile = Annotated[
    Path | None,
    typer.Option("--config", "-c", help="Settings, TOML.  [default: bushseg.toml if it exists]"),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
Profile = Annotated[bool, typer.Option("--profile", help="Print where the time went, by stage.")]
ModelFile = Annotated[
    Path | None,
    typer.Option(
        "--model",
        "-m",
        help="A bundled model (`bushseg models`), default (the bundled one that suits the scan), "
        "a model file or a run.  [default: the newest run's best if there is one, else default]",
    ),
]


def changed(**values: Any) -> dict[str, Any]:
    """The settings a user gave: those that aren't None."""
    return {name: value for name, value in values.items() if value is not None}
