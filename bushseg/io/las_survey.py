"""What has to be known of a whole scan before its first point can become a LAS point.

LAS stores coordinates as 32-bit integers and colours as 16-bit ones, so their ranges settle the
scales. Other formats' headers don't tell them: this reads the scan once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.errors import WriteError
from bushseg.io.base import ScanReader
from bushseg.points import AttributeArray, FloatArray

_COLOR_NAMES = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("scalar_red", "scalar_green", "scalar_blue"),
)
_INTENSITY_NAMES = ("intensity", "scalar_intensity", "reflectance", "i")
_FULL = 65535
_INT32_REACH = 2.0**31 - 1
_COARSEST_SCALE = 1e-3


@dataclass(frozen=True, slots=True)
class Channel:
    """How an attribute fills one of the 16-bit fields every LAS reader shows.

    Attributes:
        field: The LAS field.
        factor: What the attribute is multiplied by: 65535 for shares of 1, 257 for 8-bit colours.
        exact: Whether every value survives; one that doesn't must be kept elsewhere too.
    """

    field: str
    factor: int
    exact: bool

    def convert(self, values: AttributeArray) -> NDArray[np.uint16]:
        """The field's values; what lies outside is clipped and NaN becomes 0."""
        scaled = np.nan_to_num(values.astype(np.float64) * self.factor, nan=0.0)
        return np.clip(np.rint(scaled), 0, _FULL).astype(np.uint16)


@dataclass(frozen=True, slots=True)
class Survey:
    """A whole scan's ranges.

    Attributes:
        scales: (3,) float64, one scale for all axes.
        offsets: (3,) float64, a whole number near the middle of each axis that needs one, else 0.
        columns: Name to dtype of each attribute; a multi-valued one has a sub-array dtype.
        channels: Attribute to the field it fills: intensity and colours.
    """

    scales: FloatArray
    offsets: FloatArray
    columns: dict[str, np.dtype[Any]]
    channels: dict[str, Channel]


@dataclass(slots=True)
class _Range:
    low: float = np.inf
    high: float = -np.inf
    integral: bool = True

    def grow(self, values: AttributeArray) -> None:
        finite = values[np.isfinite(values)]
        self.integral &= len(finite) == len(values) and bool((finite == np.rint(finite)).all())
        if len(finite):
            self.low = min(self.low, float(finite.min()))
            self.high = max(self.high, float(finite.max()))


def survey(source: ScanReader) -> Survey:
    """Read a scan once for what its LAS header must say.

    Raises:
        ReadError: The scan can't be read.
        WriteError: A coordinate is NaN or infinite, or the scan is too wide for 1 mm steps.
    """
    path = source.info.path
    fields = _find_channels(source.info.attributes)
    ranges = {name: _Range() for name in fields}
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    columns: dict[str, np.dtype[Any]] = {}
    for chunk in source.chunks():
        if not np.isfinite(chunk.xyz).all():
            bad = int((~np.isfinite(chunk.xyz)).any(axis=1).sum())
            raise WriteError(
                f"{path}: {bad:,} points of one chunk have NaN or infinite coordinates, which LAS "
                "can't hold; choose .ply for the output"
            )
        low = np.minimum(low, chunk.xyz.min(axis=0))
        high = np.maximum(high, chunk.xyz.max(axis=0))
        for name, seen in ranges.items():
            seen.grow(chunk.attributes[name])
        columns = columns or {
            name: np.dtype((column.dtype, column.shape[1:]))
            for name, column in chunk.attributes.items()
        }
    middle = np.rint((low + high) / 2)
    reach = float(max((high - middle).max(), (middle - low).max()))
    scale = _choose_scale(path, float((high - low).max()), reach)
    # Without an offset a coordinate of 0 stays exactly 0: it may stand for a pulse lost.
    needs_offset = np.maximum(np.abs(low), np.abs(high)) / scale > _INT32_REACH
    return Survey(
        np.full(3, scale),
        np.where(needs_offset, middle, 0.0),
        columns,
        _settle_channels(fields, ranges, columns),
    )


def _choose_scale(path: Path, extent: float, reach: float) -> float:
    """A power of ten with seven digits over the extent (a float32's precision), 0.1 mm at most.

    Coarser only where 32 bits don't reach: up to 1 mm.
    """
    scale = min(1e-4, 10.0 ** np.floor(np.log10(max(extent, 1e-3) / 1e7)))
    while reach / scale > _INT32_REACH:
        scale *= 10
    if scale > _COARSEST_SCALE * 1.01:
        raise WriteError(
            f"{path}: spans {extent:,.0f} m, and LAS reaches 4,294,967 m in steps of 1 mm; choose "
            ".ply for the output, or remove points that lie astray"
        )
    return float(f"{scale:.0e}")  # the decimal itself, free of the rounding of its products


def _find_channels(attributes: Mapping[str, np.dtype[Any]]) -> dict[str, str]:
    """Attribute to LAS field, for the first naming of each kind that is there."""
    by_lower = {name.lower(): name for name, dtype in attributes.items() if dtype.kind in "uif"}
    found = {}
    for intensity in _INTENSITY_NAMES:
        if intensity in by_lower:
            found[by_lower[intensity]] = "intensity"
            break
    for colors in _COLOR_NAMES:
        if all(color in by_lower for color in colors):
            found |= {
                by_lower[color]: field for color, field in zip(colors, _COLOR_NAMES[0], strict=True)
            }
            break
    return found


def _settle_channels(
    fields: dict[str, str], ranges: dict[str, _Range], columns: dict[str, np.dtype[Any]]
) -> dict[str, Channel]:
    """One factor for the intensity and one for the three colours, which belong together."""
    factors: dict[bool, int] = {}
    for is_color in (False, True):
        names = [name for name, field in fields.items() if (field != "intensity") == is_color]
        low = min((ranges[name].low for name in names), default=0.0)
        top = max((ranges[name].high for name in names), default=0.0)
        is_share = all(columns[name].kind == "f" for name in names) and low >= 0 and top <= 1
        factors[is_color] = _FULL if is_share else 257 if is_color and top <= 255 else 1
    channels = {}
    for name, field in fields.items():
        factor, seen = factors[field != "intensity"], ranges[name]
        exact = seen.integral and seen.low >= 0 and seen.high * factor <= _FULL
        channels[name] = Channel(field, factor, exact)
    return channels
