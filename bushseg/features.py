"""What a scan can tell the network beside its shape: color, intensity, height above ground.

Files name and scale these as they please; the network sees them centered, of about unit spread, and
zero where a scan lacks them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bushseg.points import PointCloud
from bushseg.scratch import Scratch

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

_COLORS = ("red", "green", "blue")
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
            found |= {our: exact[name.lower()] for our, name in zip(_COLORS, triple, strict=True)}
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


def full_scale(top: float) -> float:
    """The value that stands for full brightness, by the largest of a whole scan's colors.

    Returns:
        1 for unit range, 255 for 8 bit, 65535 for 16 bit.
    """
    return 1.0 if top <= 1 else 255.0 if top <= 255 else 65535.0


@dataclass(frozen=True, slots=True)
class Scaling:
    """How a scan's values come to the network's scale.

    Colors: 8 bit, 16 bit or unit range, told apart by their largest value, become [-1, 1].
    Intensity has no common unit between sensors: it is centered on the scan's median and divided by
    its 10-90 % span, then clipped to [-2, 2]. Height is divided by 5 m. A column that never changes
    (writers fill what they lack with zeros) counts as absent.

    Attributes:
        brightest: The value of full brightness; None without colors.
        intensity: The median and the span; None without intensity.
    """

    brightest: float | None
    intensity: tuple[float, float] | None

    @classmethod
    def of(cls, values: Mapping[str, NDArray[np.float32]], scratch: Scratch | None = None) -> Self:
        """Find a scan's.

        Args:
            values: Voxel means by name, each (N,) float32, as :func:`source_values` names them.
            scratch: What made them; None for memory.
        """
        brightest, intensity, scratch = None, None, scratch or Scratch()
        if "red" in values:
            colors = [values[name] for name in _COLORS]
            spans = [_span(column, scratch) for column in colors]
            if any(low < high for low, high in spans):
                brightest = full_scale(max(high for _, high in spans))
        if "intensity" in values:
            sample = scratch.sample(values["intensity"], _QUANTILE_POINTS)
            low, middle, high = np.quantile(sample, (0.1, 0.5, 0.9)) if len(sample) else (0, 0, 0)
            if high > low:
                intensity = float(middle), float(high - low)
        return cls(brightest, intensity)

    @property
    def features(self) -> dict[str, int]:
        """The features there are, and their columns, in the order of `FEATURES`."""
        present = {
            "rgb": self.brightest is not None,
            "intensity": self.intensity is not None,
            "height": True,
        }
        return {name: columns for name, columns in FEATURES.items() if present[name]}

    def apply(
        self, values: Mapping[str, NDArray[np.float32]], height: NDArray[np.float32]
    ) -> dict[str, NDArray[np.float32]]:
        """Scale some voxels' values.

        Args:
            values: As in :meth:`of`, of any of the scan's voxels, (N,) float32 each.
            height: Metres above ground, (N,) float32.

        Returns:
            Feature name to (N, columns) float32, in the order of `FEATURES`.
        """
        features: dict[str, NDArray[np.float32]] = {}
        if self.brightest is not None:
            rgb = np.stack([values[name] for name in _COLORS], axis=1)
            features["rgb"] = (rgb / self.brightest * 2 - 1).astype(np.float32)
        if self.intensity is not None:
            middle, span = self.intensity
            scaled = (values["intensity"] - middle) / span
            features["intensity"] = np.clip(scaled, -2, 2).astype(np.float32)[:, None]
        features["height"] = (height / np.float32(HEIGHT_SCALE))[:, None]
        return features


def normalize(
    values: Mapping[str, NDArray[np.float32]], height: NDArray[np.float32]
) -> dict[str, NDArray[np.float32]]:
    """Bring all of a scan's values to the network's scale; see :class:`Scaling`."""
    return Scaling.of(values).apply(values, height)


def _span(column: NDArray[np.float32], scratch: Scratch) -> tuple[float, float]:
    """The least and the largest value."""
    low, high = np.inf, -np.inf
    for rows in scratch.blocks(len(column)):
        low, high = min(low, float(column[rows].min())), max(high, float(column[rows].max()))
    return low, high


def height_profile(
    height: NDArray[np.float32], scratch: Scratch | None = None
) -> tuple[float, float, float]:
    """How high a scan reaches, and how much of it lies near the ground.

    Args:
        height: The feature of that name, shape (N, 1), float32; N >= 1.
        scratch: What made it; None for memory.

    Returns:
        The 1 % and the 99 % quantile in metres, and the share of voxels within `NEAR_GROUND`.
    """
    metres = (scratch or Scratch()).sample(height[:, 0], _QUANTILE_POINTS) * HEIGHT_SCALE
    low, high = np.quantile(metres, (0.01, 0.99))
    return float(low), float(high), float((np.abs(metres) <= NEAR_GROUND).mean())
