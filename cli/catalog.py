"""`bushseg labels`, `bushseg models` and `bushseg config`: what there is."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import out, print_json
from .options import ConfigFile, Json, ModelFile

if TYPE_CHECKING:
    from bushseg.checkpoint import ModelCard


def labels(
    scheme: Annotated[str | None, typer.Argument(help="Show this scheme's classes.")] = None,
    as_toml: Annotated[
        bool, typer.Option("--toml", help="Print it as TOML, to begin one of your own.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List the class schemes, or one scheme's classes.

    Examples:

        bushseg labels

        bushseg labels bush --toml > mine.toml
    """
    from bushseg.labels import SCHEMES, dump_scheme, load_scheme

    if scheme is None:
        if as_json:
            print_json({name: known.model_dump(mode="json") for name, known in SCHEMES.items()})
            return
        for known in SCHEMES.values():
            out.print(f"{known.name:14} {known.num_classes:3} classes: {', '.join(known.names)}")
        return
    chosen = load_scheme(scheme)
    if as_json:
        print_json(chosen.model_dump(mode="json"))
    elif as_toml:
        out.print(dump_scheme(chosen))
    else:
        out.print(f"{'index':>5}  {'class':24} {'codes':16} {'LAS':>4}  color")
        for index, info in enumerate(chosen.classes):
            codes = ", ".join(map(str, info.codes))
            out.print(f"{index:5}  {info.name:24} {codes:16} {info.asprs:4}  {info.color}")
        out.print(f"   -1  (unlabelled)             {', '.join(map(str, chosen.unlabelled))}")


def models(model: ModelFile = None, as_json: Json = False) -> None:
    """List the models there are, or describe one.

    With --model: its classes, features and settings, its scores, and its parameters by module.

    Examples:

        bushseg models

        bushseg models --model close
    """
    if model is None:
        _list_models(as_json=as_json)
        return
    from bushseg.model_choice import candidates
    from bushseg.models.bushnet import count_parameters

    loaded = candidates(model)[0].load()
    counts = count_parameters(loaded.network)
    if as_json:
        described = loaded.card.model_dump(mode="json")
        print_json({"path": loaded.path, "card": described, "parameters": counts})
        return
    card = loaded.card
    low, high = card.neighbor_distance
    out.print(f"{loaded.path}")
    out.print(f"  classes      {', '.join(card.scheme.names)} (scheme {card.scheme.name})")
    out.print(
        f"  features     {', '.join(card.features)}"
        f" (can do without: {', '.join(card.optional_features) or 'none'})"
    )
    out.print(f"  voxel size   {card.prepare.voxel_size} m")
    out.print(f"  density      {card.prepare.num_neighbors} neighbors in {low:.2f} to {high:.2f} m")
    out.print(
        f"  network      attention {card.network.attention}, SPO {card.network.spo}, "
        f"SPF {card.network.spf}, sampling {card.prepare.sampling}"
    )
    out.print("  parameters   " + ", ".join(f"{name} {n:,}" for name, n in counts.items()))
    if scores := _scores(card):
        out.print(f"  held out     {scores}")
    if card.confidence is not None:
        out.print(
            f"  confidence   {card.confidence:.1%} on the held-out split, at temperature "
            f"{card.temperature:.2f}"
        )
    if card.pretrained is not None:
        out.print(f"  began with   {card.pretrained}")


def _list_models(*, as_json: bool) -> None:
    """All models, a line or two each."""
    from bushseg.model_choice import available

    found = available()
    if as_json:
        print_json(
            [
                {
                    "name": known.name,
                    "path": known.path,
                    "num_bytes": known.num_bytes,
                    "purpose": known.purpose,
                    "voxel_size": known.card.prepare.voxel_size,
                    "temperature": known.card.temperature,
                    "metrics": known.card.metrics,
                    "is_default": known.is_default,
                }
                for known in found
            ]
        )
        return
    if not found:
        out.print("no models: none is bundled with this build and runs/ holds none; train one")
    for known in found:
        size = f"voxels of {known.card.prepare.voxel_size:g} m, {known.num_bytes / 1e6:.1f} MB"
        marked = "  (predict's default)" if known.is_default else ""
        out.print(f"{known.name:24} {size}{marked}")
        if known.purpose:
            out.print(f"{'':24} {known.purpose}")
        if scores := _scores(known.card):
            out.print(f"{'':24} held out: {scores}")


def _scores(card: "ModelCard") -> str:
    """A card's figures in a line, as far as it has them."""
    names = {"val_miou": "mIoU", "val_oa": "OA", "val_ece": "ECE"}
    found = [
        f"{ours} {card.metrics[key]:.1%}" for key, ours in names.items() if card.metrics.get(key)
    ]
    ious = {
        key.removeprefix("val_iou/"): value
        for key, value in card.metrics.items()
        if key.startswith("val_iou/") and value is not None
    }
    found += [f"{name} {value:.0%}" for name, value in ious.items()]
    return ", ".join(found)


def config(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the settings to this TOML file.")
    ] = None,
    file: ConfigFile = None,
) -> None:
    """Print every setting as it stands, as TOML for `bushseg.toml`.

    Examples:

        bushseg config

        bushseg config -o bushseg.toml
    """
    from bushseg.config import Config
    from bushseg.files import atomic_path, check_output

    text = Config.load(file).to_toml()
    if output is None:
        out.print(text)
        return
    check_output(output, overwrite=False)
    with atomic_path(output) as partial:
        partial.write_text(text, encoding="utf-8")
