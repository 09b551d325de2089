"""`bushseg simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from .console import out, print_json, progress
from .options import Json, Quiet, changed


def simulate(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the scans.")],
    sites: Annotated[int | None, typer.Option(help="How many sites.")] = None,
    size: Annotated[float | None, typer.Option(help="Edge of a site, metres.")] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help="tripod, phase, mobile, spinning, vehicle, uav or airborne.  [default: tripod]"
        ),
    ] = None,
    color: Annotated[bool | None, typer.Option(help="Give points colors.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed.  [default: 0]")] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Make up sites and scan them: labelled scans to try things with.

    Terrain, grass, bushes, trees, buildings, fences, poles, vehicles and people, ray-cast from
    chosen stations; labels are exact, and one seed always gives the same points.

    Examples:

        bushseg simulate -o scans

        bushseg simulate -o scans --sites 6 --seed 7 --sensor airborne
    """
    from bushseg.simulation import SimulateConfig
    from bushseg.simulation import simulate as run

    given = changed(num_sites=sites, size=size, seed=seed)
    given["sensor"] = changed(kind=sensor, color=color)
    with progress(quiet=quiet or as_json) as shown:
        paths = run(output, SimulateConfig.from_dict(given), progress=shown)
    if as_json:
        print_json({"scans": paths})
        return
    for path in paths:
        out.print(str(path))
