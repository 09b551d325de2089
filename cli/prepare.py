"""`bushseg prepare`."""

from pathlib import Path
from typing import Annotated

import typer

from .console import err, interruptible, out, print_json, print_stages, progress, warn
from .options import ConfigFile, Json, Profile, Quiet, changed


def prepare(
    paths: Annotated[list[Path], typer.Argument(help="Scans, or folders to search for them.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Data set's folder.")] = Path(
        "prepared"
    ),
    scheme: Annotated[
        str | None, typer.Option(help="Class scheme: a name (`bushseg labels`) or a TOML file.")
    ] = None,
    voxel_size: Annotated[
        float | None, typer.Option(help="Edge of the sub-sampling grid, metres.  [default: 0.1]")
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--for",
            help="Prepare as this model's data were, to train on from it: default (the bundled one "
            "that suits the first scan), a bundled model's name, a model file or a run.",
        ),
    ] = None,
    label_field: Annotated[
        str | None, typer.Option(help="Attribute with the class codes.  [default: the format's]")
    ] = None,
    crops: Annotated[
        int | None, typer.Option(help="Crops to draw.  [default: two passes over the data]")
    ] = None,
    crop_points: Annotated[
        int | None, typer.Option(help="Voxels in a crop.  [default: 12288]")
    ] = None,
    sampling: Annotated[
        str | None, typer.Option(help="mrs or random decimation.  [default: mrs]")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed.  [default: 0]")] = None,
    max_memory: Annotated[
        str | None,
        typer.Option(help="Memory to keep within, such as 2GB; what is beyond goes to disk."),
    ] = None,
    workers: Annotated[
        int, typer.Option(help="Processes that make scans into tiles at once; 1: on all cores.")
    ] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Have a Dask cluster do so: tcp://127.0.0.1:8786, tls://host:port. Its workers "
            "must share the scans' folders and --output. Needs the extra [cluster].",
        ),
    ] = None,
    insecure_scheduler: Annotated[
        bool,
        typer.Option("--insecure-scheduler", help="Call another machine's scheduler without tls."),
    ] = False,
    config: ConfigFile = None,
    profile: Profile = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Turn labelled scans into cached tensors for training.

    Run again, it redoes only what a changed setting or file touches; stopped or killed, the same
    command goes on where it was.

    Examples:

        bushseg prepare scans/

        bushseg prepare a.laz b.laz --scheme asprs --voxel-size 0.25

        bushseg prepare painted.laz --for default

        bushseg prepare scans/ --workers 4 --max-memory 8GB
    """
    from bushseg.config import Config
    from bushseg.preparation import prepare as run

    if profile and (workers > 1 or scheduler is not None):
        raise typer.BadParameter(
            "--profile goes with one process: leave out --workers and --scheduler"
        )
    given = changed(
        scheme=scheme,
        voxel_size=voxel_size,
        label_field=label_field,
        num_crops=crops,
        crop_points=crop_points,
        sampling=sampling,
        seed=seed,
    )
    settings = Config.load(config, {"prepare": given}).prepare
    if model is not None:
        from bushseg.pretrained import settings_for

        settings, whose = settings_for(model, paths, settings)
        if not (quiet or as_json):
            err.print(f"prepared for {whose}")
    with interruptible(), progress(quiet=quiet or as_json) as shown:
        result = run(
            paths,
            output,
            settings,
            max_memory=max_memory,
            workers=workers,
            scheduler=scheduler,
            insecure_scheduler=insecure_scheduler,
            progress=shown,
        )
    if as_json:
        print_json(result)
        return
    warn(result.warnings)
    kept = result.num_scans - result.num_redone
    out.print(
        f"{result.folder}: {result.num_scans} scans ({kept} kept from before), "
        f"{result.num_points:,} points in {result.num_voxels:,} voxels, {result.num_tiles} tiles, "
        f"{result.num_crops} crops; features {', '.join(result.features)}"
    )
    total = sum(result.class_counts.values())
    for name, count in result.class_counts.items():
        if count:
            out.print(f"  {name:24} {count:>12,} voxels  {count / total:6.1%}")
    if profile:
        print_stages(result.stages, result.seconds)
