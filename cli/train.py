"""`bushseg train`."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from .console import err, out, print_json, print_stages, progress
from .options import ConfigFile, Json, Profile, Quiet, changed


def train(
    data: Annotated[Path, typer.Argument(help="The prepared data set.")] = Path("prepared"),
    run: Annotated[
        Path | None, typer.Option("--run", "-o", help="The run's folder.  [default: runs/TIME]")
    ] = None,
    pretrained: Annotated[
        str | None,
        typer.Option(
            "--from",
            help="Begin with a model's weights: default (the bundled one of this voxel size), a "
            "bundled model's name, a model file or a run.",
        ),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="Go on with this run, exactly where it stopped.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the run that stands in --run.")
    ] = False,
    epochs: Annotated[int | None, typer.Option(help="Epochs to train.  [default: 100]")] = None,
    batch_size: Annotated[
        int | None, typer.Option(help="Crops in a step, of all processes.  [default: 4]")
    ] = None,
    learning_rate: Annotated[
        float | None,
        typer.Option(
            help="Adam's first learning rate.  [default: 0.01; with --from 0.001]",
        ),
    ] = None,
    validation: Annotated[
        str | None,
        typer.Option(help="Held out: auto, tile, none or scan:NAME[,NAME...].  [default: auto]"),
    ] = None,
    fresh_crops: Annotated[
        bool | None, typer.Option("--fresh-crops", help="Draw new crops each epoch.")
    ] = None,
    attention: Annotated[
        str | None, typer.Option(help="mam, randla, eca, se, nonlocal or axial.  [default: mam]")
    ] = None,
    spo: Annotated[bool | None, typer.Option(help="Use relative positions (Table 3).")] = None,
    spf: Annotated[bool | None, typer.Option(help="Use simple point features (Table 3).")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed.  [default: 0]")] = None,
    precision: Annotated[
        str | None,
        typer.Option(help="Products on a CPU: float32, bfloat16 or auto.  [default: float32]"),
    ] = None,
    config: ConfigFile = None,
    profile: Profile = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Train BushNet on a prepared data set.

    Ctrl-C saves and ends; `--resume` goes on as if nothing had happened, also after a crash.
    With --from, training begins with what a model knows: a few labelled points among many without
    a label then go a long way. Classes may differ; the data must be prepared with
    `bushseg prepare --for` that model.

    Examples:

        bushseg train

        bushseg train prepared --epochs 30 --validation scan:north

        bushseg train --from default --epochs 20

        bushseg train --resume runs/2026-05-01_120000

        torchrun --nproc-per-node 2 -m bushseg_cli train prepared -o runs/x
    """
    from bushseg.config import Config
    from bushseg.runs import BEST, CURVES, LAST, METRICS, SETTINGS
    from bushseg.training import train as start

    if resume is not None and (run is not None or overwrite or pretrained is not None):
        raise typer.BadParameter("--resume names the run; leave --run, --overwrite and --from out")

    settings: dict[str, dict[str, Any]] = {
        "train": changed(
            epochs=epochs,
            batch_size=batch_size,
            learning_rate=learning_rate,
            pretrained=pretrained,
            validation=validation,
            fresh_crops=fresh_crops,
            seed=seed,
            precision=precision,
        ),
        "network": changed(attention=attention, spo=spo, spf=spf),
    }
    # A resumed run keeps its own settings, unless a file is named.
    source = config or (resume / SETTINGS if resume is not None else None)
    resolved = Config.load(source, settings)
    with stoppable() as stop, progress(quiet=quiet or as_json) as shown:
        result = start(
            data,
            resume or run,
            resolved,
            resume=resume is not None,
            overwrite=overwrite,
            stop=stop,
            progress=shown,
        )
    if result.rank > 0:
        return  # the first of several processes reports
    if as_json:
        print_json(result)
        return
    if profile:
        print_stages(result.stages, sum(result.stages.values()))
    if result.interrupted:
        out.print(
            f"stopped in epoch {result.epochs + 1}; go on with "
            f"`bushseg train {data} --resume {result.folder}`"
        )
        return
    out.print(f"{result.folder}: {BEST}, {LAST}, {METRICS}, {CURVES}")
    scored = [row for row in result.history if "val_miou" in row]
    if scored:
        best = max(scored, key=lambda row: row["val_miou"])
        out.print(
            f"best on the held-out split: mIoU {best['val_miou']:.1%}, OA {best['val_oa']:.1%} "
            f"in epoch {best['epoch']:.0f}"
        )
    rate = result.num_points / max(result.seconds, 1e-9)
    out.print(f"{result.num_points:,} points in {result.seconds:.0f} s: {rate:,.0f} points/s")


@contextmanager
def stoppable() -> Iterator[Callable[[], bool]]:
    """Let the first Ctrl-C ask for an orderly end; the second ends at once."""
    asked = False

    def ask(_number: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        err.print("stopping after this step; Ctrl-C again to stop without saving")

    previous = signal.signal(signal.SIGINT, ask)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, previous)
