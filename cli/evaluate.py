"""`bushseg evaluate`."""

import math
from pathlib import Path
from typing import Annotated

import typer

from .console import out, print_json, progress
from .options import Json, Quiet


def evaluate(
    prediction: Annotated[Path, typer.Argument(help="A labelled scan, or its .label / .labels.")],
    truth: Annotated[
        Path | None,
        typer.Argument(help="The scan with the true labels; none if the prediction holds both."),
    ] = None,
    scheme: Annotated[str, typer.Option(help="Class scheme of the labels.")] = "bush",
    truth_scheme: Annotated[
        str | None, typer.Option(help="Scheme of the truth, where it is another.")
    ] = None,
    prediction_field: Annotated[
        str | None, typer.Option(help="Attribute with the predictions.  [default: class_index]")
    ] = None,
    truth_field: Annotated[
        str | None, typer.Option(help="Attribute with the truth.  [default: the format's]")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for metrics.json, the tables and a plot."),
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Compare predictions with the truth: IoU, OA, confusion matrix.

    IoU is given per class and as their mean, mIoU; where the labelled file holds `confidence`, the
    expected calibration error (15 bins) says how far it is from the share that is right.

    Examples:

        bushseg evaluate labeled.laz site.laz --scheme asprs -o report

        bushseg evaluate frame.label frame.bin --scheme rellis
    """
    from bushseg.evaluation import evaluate as run
    from bushseg.labels import load_scheme

    with progress(quiet=quiet or as_json) as shown:
        result = run(
            prediction,
            truth,
            load_scheme(scheme),
            prediction_field=prediction_field,
            truth_field=truth_field,
            truth_scheme=None if truth_scheme is None else load_scheme(truth_scheme),
            progress=shown,
        )
    if output is not None:
        result.write(output)
    if as_json:
        print_json(result.as_dict())
        return
    scores = result.confusion
    out.print(f"{'class':24} {'IoU':>7} {'precision':>9} {'recall':>7} {'F1':>7} {'points':>12}")
    columns = (scores.iou, scores.precision, scores.recall, scores.f1, scores.support)
    for name, iou, precision, recall, f1, support in zip(
        result.scheme.names, *columns, strict=True
    ):
        if not math.isnan(iou):
            out.print(
                f"{name:24} {_percent(iou):>7} {_percent(precision):>9} {_percent(recall):>7} "
                f"{_percent(f1):>7} {support:>12,}"
            )
    total = scores.support.sum()
    out.print(
        f"mIoU {scores.miou:.1%}, OA {scores.oa:.1%} over {total:,} labelled points; "
        f"the largest class is {scores.support.max() / total:.1%} of them"
    )
    if not math.isnan(result.confidence.error):
        out.print(
            f"calibration error (ECE) {result.confidence.error:.1%}: mean confidence "
            f"{result.confidence.mean_confidence:.1%}"
        )
    if output is not None:
        out.print(f"{output}: metrics.json, per_class.csv, confusion.csv, confusion.png")


def _percent(value: float) -> str:
    """A share, or a dash where it is undefined."""
    return "-" if math.isnan(value) else f"{value:.1%}"
