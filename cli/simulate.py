"""`bushseg simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from .console import out, print_json, progress
from .options import Json, Quiet, changed


def simulate(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the scans.")
    ] = None,
    sites: Annotated[int | None, typer.Option(help="How many sites.  [default: 1]")] = None,
    place: Annotated[
        str | None,
        typer.Option(
            help="garden, orchard, fields, park, road, street, forest_edge, forest, heath, "
            "village, trail, yard, or mixed, which draws one for each site.  [default: garden]"
        ),
    ] = None,
    size: Annotated[
        float | None, typer.Option(help="Edge of a site, metres.  [default: 40]")
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            help="tripod, phase, mobile, spinning, vehicle, uav, airborne or photogrammetry.  "
            "[default: tripod]"
        ),
    ] = None,
    color: Annotated[bool | None, typer.Option(help="Give points colors.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed.  [default: 0]")] = None,
    config: Annotated[
        Path | None,
        typer.Option("--config", "-c", help="Settings, TOML, such as --show-config prints."),
    ] = None,
    show_config: Annotated[
        bool, typer.Option("--show-config", help="Print all settings and stop.")
    ] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Make up sites and scan them: labelled scans to try things with.

    Terrain, grass, bushes, trees, buildings, fences, poles, vehicles and people as they stand at
    the place that is asked for, struck by a sensor's rays; labels are exact, and one seed always
    gives the same points. Every distribution can be edited: begin with --show-config.

    Examples:

        bushseg simulate -o scans

        bushseg simulate -o scans --sites 6 --seed 7 --place mixed --sensor airborne --size 100

        bushseg simulate --show-config > region.toml

        bushseg simulate -o scans --config region.toml
    """
    from bushseg.simulation import SimulateConfig
    from bushseg.simulation import simulate as run
    from bushseg.simulation.described import described

    given = changed(num_sites=sites, seed=seed, size=size, place=place)
    given["sensor"] = changed(kind=sensor, color=color)
    settings = SimulateConfig.load(config, given)
    if show_config:
        out.print(described(settings))
        return
    if output is None:
        raise typer.BadParameter("give a folder for the scans", param_hint="--output")
    with progress(quiet=quiet or as_json) as shown:
        paths = run(output, settings, progress=shown)
    if as_json:
        print_json({"scans": paths})
        return
    for path in paths:
        out.print(str(path))
