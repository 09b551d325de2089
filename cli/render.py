"""`bushseg render`."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from .console import out, progress
from .options import Quiet


class Color(StrEnum):
    """What the colors stand for."""

    BY_CLASS = "class"
    RGB = "rgb"
    HEIGHT = "height"


def render(
    scan: Annotated[Path, typer.Argument(help="The scan to draw.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The picture, PNG.")],
    color: Annotated[Color, typer.Option(help="What to color by.")] = Color.BY_CLASS,
    scheme: Annotated[str, typer.Option(help="Class scheme, for names and colors.")] = "bush",
    azimuth: Annotated[float, typer.Option(help="Where the eye stands, degrees from x.")] = 225.0,
    elevation: Annotated[float, typer.Option(help="How high it stands; 90 looks down.")] = 35.0,
    overwrite: Annotated[bool, typer.Option(help="Replace an existing picture.")] = False,
    quiet: Quiet = False,
) -> None:
    """Draw a scan as a picture.

    Examples:

        bushseg render labeled.laz -o labeled.png

        bushseg render site.laz -o site.png --color rgb --elevation 60
    """
    from bushseg.labels import load_scheme
    from bushseg.picture import picture

    with progress(quiet=quiet) as shown:
        picture(
            scan,
            output,
            color.value,
            load_scheme(scheme),
            view=(azimuth, elevation),
            overwrite=overwrite,
            progress=shown,
        )
    out.print(str(output))
