"""What a scan can tell the network beside its shape: color, intensity, height above ground.

Files name and scale these as they please; the network sees them centered, of about unit spread, and
zero where a scan lacks them.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.points import PointCloud

FEATURES: dict[str, int] = {"rgb": 3, "intensity": 1, "height": 1}
"""Every feature and the number of its columns, in the order the network takes them."""

COLOR_NAMES = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("colorRed", "colorGreen", "colorBlue"),
)
INTENSITY_NAMES = ("intensity", "scalar_Intensity", "scalar_intensity", "reflectance", "i")

HEIGHT_SCALE = 5.0  # metres: about where bushes end and trees go on
NEAR_GROUND = 0.5
"""Metres above ground up to which a voxel counts as near it."""

_QUANTILE_POINTS = 1_000_000


def source_columns(names: Mapping[str, Any]) -> dict[str, str]:
    """Which of a scan's attributes hold color and intensity, whatever their spelling.

    Args:
        names: The scan's attribute names (the values don't matter).

    Returns:
        Our name ("red", "green", "blue", "intensity", or "packed" for one column that packs all
        three colors) to the scan's name.
    """
    exact = {name.lower(): name for name in names}
    found: dict[str, str] = {}
    for triple in COLOR_NAMES:
        if all(name.lower() in exact for name in triple):
            ours = ("red", "green", "blue")
            found |= {our: exact[name.lower()] for our, name in zip(ours, triple, strict=True)}
            break
    else:
        packed = next((name for name in ("rgb", "rgba") if name in exact), None)
        if packed is not None:
            found["packed"] = exact[packed]
    for name in INTENSITY_NAMES:
        if name.lower() in exact:
            found["intensity"] = exact[name.lower()]
            break
    return found


def source_values(cloud: PointCloud, columns: Mapping[str, str]) -> dict[str, NDArray[np.float32]]:
    """The columns that :func:`source_columns` found, as float32 in the file's own scale.

    Values that are not finite become 0.

    Returns:
        "red", "green", "blue" and "intensity", as far as the scan has them, each (N,) float32.
    """
    values: dict[str, NDArray[np.float32]] = {}
    for ours, theirs in columns.items():
        column = cloud.attributes[theirs]
        if ours == "packed":
            # PCL packs 0xRRGGBB into the bits of a float32, or of an unsigned integer.
            is_float = column.dtype == np.float32
            bits = column.view(np.uint32) if is_float else column.astype(np.uint32)
            for name, shift in (("red", 16), ("green", 8), ("blue", 0)):
                values[name] = ((bits >> shift) & 0xFF).astype(np.float32)
        else:
            with np.errstate(over="ignore"):  # what float32 can't hold is infinite, so 0 too
                single = column.astype(np.float32)
            if column.dtype.kind == "f":
                single[~np.isfinite(single)] = 0
            values[ours] = single
    return values


def full_scale(colors: NDArray[np.float32]) -> float:
    """The value that stands for full brightness, by the largest of a whole scan's colors.

    Args:
        colors: Of any shape, float32.

    Returns:
        1 for unit range, 255 for 8 bit, 65535 for 16 bit.
    """
    top = float(colors.max(initial=0))
    return 1.0 if top <= 1 else 255.0 if top <= 255 else 65535.0


def normalize(
    values: Mapping[str, NDArray[np.float32]], height: NDArray[np.float32]
) -> dict[str, NDArray[np.float32]]:
    """Bring a scan's values to the network's scale.

    Colors: 8 bit, 16 bit or unit range, told apart by their largest value, become [-1, 1].
    Intensity has no common unit between sensors: it is centered on the scan's median and divided by
    its 10-90 % span, then clipped to [-2, 2]. Height is divided by 5 m. A column that never changes
    (writers fill what they lack with zeros) counts as absent.

    Args:
        values: Voxel means by name, each (N,) float32, as :func:`source_values` names them.
        height: Metres above ground, (N,) float32.

    Returns:
        Feature name to (N, columns) float32, in the order of `FEATURES`.
    """
    features: dict[str, NDArray[np.float32]] = {}
    if "red" in values:
        rgb = np.stack([values["red"], values["green"], values["blue"]], axis=1)
        if (rgb != rgb[:1]).any():
            features["rgb"] = (rgb / full_scale(rgb) * 2 - 1).astype(np.float32)
    if "intensity" in values:
        intensity = values["intensity"]
        sample = intensity[:: max(1, len(intensity) // _QUANTILE_POINTS)]
        low, middle, high = np.quantile(sample, (0.1, 0.5, 0.9)) if len(sample) else (0, 0, 0)
        if high > low:
            scaled = (intensity - middle) / (high - low)
            features["intensity"] = np.clip(scaled, -2, 2).astype(np.float32)[:, None]
    features["height"] = (height / np.float32(HEIGHT_SCALE))[:, None]
    return features


def height_profile(height: NDArray[np.float32]) -> tuple[float, float, float]:
    """How high a scan reaches, and how much of it lies near the ground.

    Args:
        height: The feature of that name, shape (N, 1), float32; N >= 1.

    Returns:
        The 1 % and the 99 % quantile in metres, and the share of voxels within `NEAR_GROUND`.
    """
    metres = height[:: max(1, len(height) // _QUANTILE_POINTS), 0] * HEIGHT_SCALE
    low, high = np.quantile(metres, (0.01, 0.99))
    return float(low), float(high), float((np.abs(metres) <= NEAR_GROUND).mean())
