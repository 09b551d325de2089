"""`bushseg info`."""

from pathlib import Path
from typing import Annotated

import typer

from .console import err, out, print_json, progress
from .options import Json, Quiet


def info(
    scans: Annotated[list[Path], typer.Argument(help="Scans, or folders to search for them.")],
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Describe scans: format, extent, CRS, density, classes, faults.

    Every point is read; attributes come with their ranges. Exit status 1 if any scan can't be read.

    Examples:

        bushseg info site.laz

        bushseg info scans/ --json
    """
    from bushseg.info import describe
    from bushseg.io import find_scans

    reports = []
    for path in find_scans(scans):
        with progress(quiet=quiet or as_json) as shown:  # gone before the lines are printed
            report = describe(path, progress=shown)
        reports.append(report)
        if as_json:
            continue
        for line in report.lines():
            out.print(line)
    if as_json:
        print_json(reports)
    failed = [report for report in reports if report.error is not None]
    if failed:
        if len(reports) > 1 and not as_json:
            err.print(f"{len(failed)} of {len(reports)} scans can't be read", style="red")
        raise typer.Exit(1)
