"""A scan as a picture: which colors its points get, and a drawing of them."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import DataError
from bushseg.features import full_scale, source_columns, source_values
from bushseg.files import check_output
from bushseg.io import open_scan
from bushseg.io.base import ScanReader
from bushseg.points import FloatArray, PointCloud
from bushseg.progress import SILENT, Progress
from bushseg.render import render
from bushseg.scheme import ClassScheme

ColorBy = Literal["class", "rgb", "height"]

MAX_POINTS = 8_000_000
"""A picture has fewer pixels: of larger scans every n-th point is drawn."""

_GRAY = np.array([150, 150, 150], dtype=np.uint8)
_LOW, _HIGH = np.array([40, 70, 120.0]), np.array([250, 235, 150.0])


def picture(
    scan: str | Path,
    output: str | Path,
    color_by: ColorBy,
    scheme: ClassScheme,
    *,
    view: tuple[float, float] = (225.0, 35.0),
    overwrite: bool = False,
    progress: Progress = SILENT,
) -> None:
    """Draw a scan into a PNG file.

    Args:
        scan: The scan.
        output: The picture.
        color_by: "class" (`class_index` if the scan has it, else its label attribute), "rgb" or
            "height".
        scheme: Names and colors of the classes.
        view: Azimuth and elevation of the eye, degrees.
        overwrite: Whether an existing picture may be replaced.
        progress: Told of the points read.

    Raises:
        DataError: The scan has no labels, or no colors, and they were asked for.
        BushsegError: The scan can't be read or the picture can't be written.
    """
    check_output(output, (scan,), overwrite=overwrite)
    xyz: list[FloatArray] = []
    shades: list[NDArray[Any]] = []
    with open_scan(scan) as reader:
        step = -(-reader.info.num_points // MAX_POINTS)
        progress.start(f"reading {reader.info.path.name}", reader.info.num_points, "points")
        for chunk in reader.chunks():
            xyz.append(chunk.xyz[::step])
            if color_by == "class":
                shades.append(class_colors(chunk, reader, scheme)[::step])
            elif color_by == "rgb":
                shades.append(true_colors(chunk, reader)[::step])
            progress.advance(len(chunk))
    points = np.concatenate(xyz)
    colors: NDArray[Any] = np.concatenate(shades) if shades else height_colors(points)
    if color_by == "rgb":
        # Scaled only now: a dark chunk by itself may look like another range than the scan's.
        colors = colors * (255 / full_scale(float(colors.max(initial=0))))
    render(points, colors.astype(np.uint8), output, view=view)


def class_colors(chunk: PointCloud, reader: ScanReader, scheme: ClassScheme) -> NDArray[np.uint8]:
    """Each point's class color, gray where it has none, (N, 3) uint8."""
    if "class_index" in chunk.attributes:
        labels = scheme.encode_indices(chunk.attributes["class_index"]).labels
    elif reader.info.label_attribute is not None:
        labels = scheme.encode(chunk.attributes[reader.info.label_attribute]).labels
    else:
        raise DataError(f"{reader.info.path}: has no labels to color by; try rgb or height")
    return np.concatenate([scheme.colors, _GRAY[None]])[labels]


def true_colors(chunk: PointCloud, reader: ScanReader) -> NDArray[np.float32]:
    """Each point's own color in the file's own scale, (N, 3) float32."""
    values = source_values(chunk, source_columns(chunk.attributes))
    if "red" not in values:
        raise DataError(f"{reader.info.path}: has no colors; color by class or height")
    return np.stack([values[name] for name in ("red", "green", "blue")], axis=1)


def height_colors(xyz: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Blue to yellow from the lowest to the highest percent of finite points, (N, 3) uint8."""
    finite = np.isfinite(xyz[:, 2])
    low, high = np.quantile(xyz[finite, 2], (0.01, 0.99)) if finite.any() else (0.0, 0.0)
    z = np.where(finite, xyz[:, 2], low)
    share = np.clip((z - low) / max(high - low, 1e-9), 0, 1)[:, None]
    return (_LOW + share * (_HIGH - _LOW)).astype(np.uint8)
