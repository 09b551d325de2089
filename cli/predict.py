"""`bushseg predict`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import interruptible, out, print_json, print_stages, progress, shorten, warn
from .options import ConfigFile, Json, ModelFile, Profile, Quiet, changed
from .verify import print_verified

if TYPE_CHECKING:
    from bushseg.config import PredictConfig


def predict(
    scans: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCAN...", help="The scan, scans or folders to label; they are never touched."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="The labelled scan, whose suffix says the format; of several, their folder.",
        ),
    ],
    model: ModelFile = None,
    suffix: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="SUFFIX",
            help="Into a folder: the outputs' suffix, such as .laz.  [default: each scan's own; "
            ".copc.laz becomes .laz, .e57 .las, .bin .label]",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace an existing output.")] = False,
    verify: Annotated[
        bool, typer.Option("--verify", help="Then compare the output with the scan, byte by byte.")
    ] = False,
    keep_classification: Annotated[
        bool | None,
        typer.Option(
            "--keep-classification", help="Leave LAS classification alone; only add dimensions."
        ),
    ] = None,
    asprs: Annotated[
        list[str] | None,
        typer.Option(metavar="CLASS=CODE", help="Write a class as this LAS code; repeatable."),
    ] = None,
    tile_points: Annotated[
        int | None, typer.Option(help="Voxels in a tile's core.  [default: 500000]")
    ] = None,
    halo: Annotated[
        int | None, typer.Option(help="Context around a tile, voxels.  [default: the model's]")
    ] = None,
    max_memory: Annotated[
        str | None, typer.Option(help="Memory to keep within, such as 2GB; sizes the tiles.")
    ] = None,
    scratch: Annotated[
        Path | None,
        typer.Option(help="Folder for what memory can't hold.  [default: beside the output]"),
    ] = None,
    precision: Annotated[
        str | None,
        typer.Option(help="Products on a CPU: float32, bfloat16 or auto.  [default: auto]"),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Processes that label tiles, or a folder's scans, at once.  [default: 1, on all "
            "cores]"
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Have a Dask cluster do so: tcp://127.0.0.1:8786, tls://host:port. Its workers "
            "must share the folder of --scratch; of many scans, theirs and the outputs'. Needs the "
            "extra [cluster].",
        ),
    ] = None,
    insecure_scheduler: Annotated[
        bool | None,
        typer.Option("--insecure-scheduler", help="Call another machine's scheduler without tls."),
    ] = None,
    config: ConfigFile = None,
    profile: Profile = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Label every point of a scan.

    LAS and LAZ keep every field, VLR, EVLR and the CRS; classification is set to ASPRS codes, and
    class_index, confidence and (if the model knows bush) bush_probability are added. Without a run
    in runs/ and without --model, the bundled model is taken that suits the scan's density.

    Stopped or killed, the same command goes on where it was. Of a folder, the outputs have the
    scans' places and names; what was done of the same scan with the same model and settings is
    skipped, a broken scan doesn't stop the others, and the exit status is 1 if any failed.

    Examples:

        bushseg predict site.las -o labeled.las

        bushseg predict plot.laz -o labeled.laz --model close

        bushseg predict scans/ -o labeled/

        bushseg predict frame.bin -o frame.label --model runs/2026-05-01_120000

        bushseg predict site.laz -o labeled.laz --asprs bush=4 --overwrite

        bushseg predict county.laz -o labeled.laz --max-memory 2GB --scratch /big/disk

        bushseg predict scans/ -o labeled/ --workers 4

        bushseg predict county.laz -o labeled.laz --scheduler tls://head:8786 --scratch /shared
    """
    from bushseg.config import Config

    given = changed(
        tile_points=tile_points,
        halo=halo,
        max_memory=max_memory,
        scratch=scratch,
        precision=precision,
        workers=workers,
        scheduler=scheduler,
        insecure_scheduler=insecure_scheduler,
        keep_classification=keep_classification,
        asprs=_codes(asprs) if asprs else None,
    )
    settings = Config.load(config, {"predict": given}).predict
    with interruptible():
        if len(scans) > 1 or scans[0].is_dir() or output.is_dir():
            if profile:
                raise typer.BadParameter("--profile goes with one scan and one output file")
            _predict_folder(
                scans, output, model, settings, suffix, overwrite, verify, quiet, as_json
            )
        else:
            if suffix is not None:
                raise typer.BadParameter("--format goes with a folder; name the output with it")
            _predict_file(
                scans[0], output, model, settings, overwrite, verify, profile, quiet, as_json
            )


def _predict_file(
    scan: Path,
    output: Path,
    model: Path | None,
    settings: "PredictConfig",
    overwrite: bool,
    verify: bool,
    profile: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    from bushseg.prediction import predict_file
    from bushseg.verification import verify as prove

    with progress(quiet=quiet or as_json) as shown:
        result = predict_file(scan, output, model, settings, overwrite=overwrite, progress=shown)
        proof = prove(scan, result.output, progress=shown) if verify else None
    if as_json:
        print_json(result if proof is None else {**asdict(result), "verified": proof})
        if proof is not None and not proof.equal:
            raise typer.Exit(1)
        return
    warn(result.warnings)
    memory = (
        "" if result.peak_memory is None else f", peak memory {result.peak_memory / 1e9:.2f} GB"
    )
    out.print(
        f"{result.output}: {result.num_points:,} points in {result.seconds:.1f} s "
        f"({shorten(result.points_per_second)} points/s{memory}), model {result.model}, "
        f"features {', '.join(result.features)}"
    )
    if result.reason:
        out.print(f"  model: {result.model}, {result.reason}")
    for name, count in result.class_counts.items():
        if count:
            out.print(f"  {name:24} {count:>12,} points  {count / result.num_points:6.1%}")
    if result.num_unlabelled:
        out.print(f"  {'(no label)':24} {result.num_unlabelled:>12,} points")
    if profile:
        print_stages(result.stages, result.seconds)
    if proof is not None:
        print_verified(proof)
        if not proof.equal:
            raise typer.Exit(1)


def _predict_folder(
    scans: list[Path],
    output: Path,
    model: Path | None,
    settings: "PredictConfig",
    suffix: str | None,
    overwrite: bool,
    verify: bool,
    quiet: bool,
    as_json: bool,
) -> None:
    from bushseg.folder_prediction import predict_folder

    with progress(quiet=quiet or as_json) as shown:
        result = predict_folder(
            scans,
            output,
            model,
            settings,
            suffix=suffix,
            overwrite=overwrite,
            verify=verify,
            progress=shown,
        )
    counts = {status: result.count(status) for status in ("done", "skipped", "failed", "left")}
    if as_json:
        print_json({**asdict(result), "counts": counts})
    else:
        for scan in result.scans:
            if scan.result is not None:
                warn([f"{scan.input}: {warning}" for warning in scan.result.warnings])
        for scan in result.scans:
            if scan.error:
                out.print(f"failed: {scan.error}")
        out.print(
            f"{result.output}: {counts['done']} of {len(result.scans)} scans labelled "
            f"({result.num_points:,} points in {result.seconds:.1f} s), {counts['skipped']} done "
            f"before, {counts['failed']} failed"
            + (f", {counts['left']} left since the disk is full" if counts["left"] else "")
        )
    if not result.complete:
        raise typer.Exit(1)


def _codes(pairs: list[str]) -> dict[str, int]:
    """CLASS=CODE options."""
    codes = {}
    for pair in pairs:
        name, _, code = pair.partition("=")
        if not code.isdecimal():
            raise typer.BadParameter(f"{pair!r}; expected CLASS=CODE, such as bush=4")
        codes[name] = int(code)
    return codes
