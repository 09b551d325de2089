"""Real scans as a model labels them, in one picture.

python benchmarks/gallery.py ../shared/data [--model default] [--output docs/real_scans.png]
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from judging import BUSH, Network, read_scan
from matplotlib.patches import Patch

from bushseg.points import FloatArray
from bushseg.render import draw

WIDTH, HEIGHT = 960, 600
"""Of one scan's picture, pixels."""


class Shown(NamedTuple):
    """A scan and how it is looked at.

    Attributes:
        name: Its file, relative to the data folder.
        title: What it is.
        view: Azimuth and elevation of the eye, degrees.
        point_size: Edge of a point's square, pixels.
        reach: Half the edge of the square that is shown about the origin, metres.
    """

    name: str
    title: str
    view: tuple[float, float]
    point_size: int = 2
    reach: float = np.inf


SCANS = (
    Shown("forest/MLS_Clip.laz", "carried", (225, 25)),
    Shown("forest/LPine1_demo.laz", "tripod", (225, 25)),
    Shown("frames/seq00_000000.bin", "64-beam frame of a street", (215, 45), 3, 35),
    Shown("forest/lone-star.laz", "a single tree", (225, 20)),
    Shown("ign/ign_77055_627760.laz", "airborne survey", (225, 35), 3),
    Shown("forest/bcts_1.laz", "airborne, forest", (225, 35)),
)


def main() -> None:
    """Label and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder of the real scans")
    parser.add_argument("--model", default="default")
    parser.add_argument("--output", type=Path, default=Path("docs/real_scans.png"))
    options = parser.parse_args()
    network = Network(options.model)
    figure, axes = plt.subplots(2, 3, figsize=(14.4, 6.8), dpi=130, layout="constrained")
    for axis, shown in zip(axes.flat, SCANS, strict=True):
        scan = read_scan(options.data / shown.name)
        probabilities = network.label(scan)
        seen = probabilities.any(axis=1) & within(scan.cloud.xyz, shown.reach)
        image = draw(
            scan.cloud.xyz[seen],
            BUSH.colors[probabilities[seen].argmax(axis=1)],
            view=shown.view,
            width=WIDTH,
            height=HEIGHT,
            field_of_view=35.0,
            point_size=shown.point_size,
            lighting=1.0,
        )
        axis.imshow(image)
        axis.set_title(f"{Path(shown.name).name}: {shown.title}", fontsize=10)
        axis.axis("off")
    legend = [
        Patch(color=color / 255, label=name.replace("_", " "))
        for name, color in zip(BUSH.names, BUSH.colors, strict=True)
    ]
    figure.legend(handles=legend, loc="outside lower center", ncols=len(legend), frameon=False)
    figure.savefig(options.output)
    print(options.output)


def within(xyz: FloatArray, reach: float) -> np.ndarray:
    """Whether each point lies in the square about the origin, (N,) bool."""
    return (np.abs(xyz[:, :2]) <= reach).all(axis=1) | np.isinf(reach)


if __name__ == "__main__":
    main()
