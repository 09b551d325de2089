"""`bushseg`: every command, and one way to fail.

A command is options and one call into the library. Nothing heavy is imported before a command
runs, so that `bushseg --help` answers at once.
"""

import sys
from typing import Annotated

import typer

from bushseg.errors import BushsegError

from .catalog import config, labels, models
from .console import err
from .evaluate import evaluate
from .info import info
from .predict import predict
from .prepare import prepare
from .render import render
from .simulate import simulate
from .train import train
from .verify import verify

app = typer.Typer(
    name="bushseg",
    help="Find bushes in point clouds: scans in, labelled scans out.\n\n"
    "Start with `bushseg simulate -o scans`, or with labelled scans of your own; then "
    "`bushseg prepare scans`, `bushseg train`, `bushseg predict site.las -o labeled.las`.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # importing the panels would take longer than all the rest of --help
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    *(info, prepare, train, predict, verify, evaluate, render, simulate),
    *(labels, models, config),
):
    app.command()(command)


@app.callback(invoke_without_command=True)
def _version(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        from importlib.metadata import version as installed

        typer.echo(f"bushseg {installed('bushseg')}")
        raise typer.Exit


def main() -> None:
    """Run the command line; a BushsegError is one line on standard error and exit status 1."""
    try:
        app()
    except BushsegError as error:
        err.print(f"error: {error}", style="red")
        sys.exit(1)
    except OSError as error:
        err.print(f"error: {error}; check the disk and its permissions", style="red")
        sys.exit(1)
    except MemoryError:
        err.print(
            "error: out of memory; predict takes less with --max-memory or smaller --tile-points, "
            "prepare with a larger voxel_size or a smaller tile_points"
        )
        sys.exit(1)
