"""`bushseg verify`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import out, print_json, progress
from .options import Json, Quiet

if TYPE_CHECKING:
    from bushseg.verification import VerifyResult


def verify(
    scan: Annotated[Path, typer.Argument(metavar="INPUT", help="The scan that was labelled.")],
    output: Annotated[Path, typer.Argument(help="What was made of it.")],
    scheme: Annotated[
        str | None,
        typer.Option(help="Class scheme that class_index must be of.  [default: any]"),
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Prove that a labelled scan still is the scan it was made from.

    Every point's record in order, VLRs, EVLRs, CRS and header must be what they were, but for what
    labelling declares. Both files are read by other means than predict's. Exit status 1 where
    anything differs, with a line that says what, where, and both values.

    Examples:

        bushseg verify site.las labeled.las

        bushseg verify frame.bin frame.label --scheme rellis --json
    """
    from bushseg.labels import load_scheme
    from bushseg.verification import verify as run

    classes = None if scheme is None else load_scheme(scheme)
    with progress(quiet=quiet or as_json) as shown:
        result = run(scan, output, classes, progress=shown)
    if as_json:
        print_json(result)
    else:
        print_verified(result)
    if not result.equal:
        raise typer.Exit(1)


def print_verified(result: "VerifyResult") -> None:
    """A line a thing checked, a line a difference."""
    changed = "" if result.num_changed is None else f", {result.num_changed:,} class codes changed"
    verdict = "equal to" if result.equal else "DIFFERS from"
    out.print(f"{result.output}: {verdict} {result.input}; {result.num_points:,} points{changed}")
    for check in result.checks:
        state = "differs" if check.differences else "ok"
        out.print(f"  {state:8} {check.name:18} {check.compared}".rstrip())
        for line in check.differences:
            out.print(f"           {line}")
    if result.declared:
        out.print(f"  declared {', '.join(result.declared)}")
