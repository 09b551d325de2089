"""Colors as a camera sees them: sun and shadow, haze, and how it was set that day."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bushseg.geometry import open3d
from bushseg.points import FloatArray

SKY = np.array([196.0, 208.0, 222.0])
"""What haze turns everything into."""

SHADE = 0.45
"""Light in the shadow, as a share of that in the sun."""

CLEARANCE = 0.02
"""Rays to the sun begin so far off the surface, metres."""


@dataclass(slots=True)
class Daylight:
    """One site's light and its camera.

    Attributes:
        rng: Draws a camera's setting for each station.
        sun: Where the sun is, a unit vector, shape (3,).
        visibility: Where haze leaves 2 % of the contrast, metres.
        shadows: Whether things cast shadows.
        settings: Gains of red, green and blue by station.
    """

    rng: np.random.Generator
    sun: FloatArray
    visibility: float
    shadows: bool
    settings: dict[int, FloatArray] = field(default_factory=dict)

    @classmethod
    def draw(cls, rng: np.random.Generator, visibility: float, *, shadows: bool) -> "Daylight":
        """A sun between 20 and 65 degrees high."""
        azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(20, 65))
        out = np.cos(elevation)
        sun = np.array([np.cos(azimuth) * out, np.sin(azimuth) * out, np.sin(elevation)])
        return cls(rng, sun, visibility, shadows)

    def colors(
        self,
        caster: Any,
        albedo: FloatArray,
        places: FloatArray,
        normals: FloatArray,
        ranges: FloatArray,
        station: int,
    ) -> FloatArray:
        """What a camera at the sensor sees.

        Args:
            caster: The scene, as Open3D casts it.
            albedo: Red, green and blue of what is seen, 0 to 255, shape (N, 3).
            places: Where it is, metres, shape (N, 3).
            normals: Unit vectors, of either sign, shape (N, 3).
            ranges: Metres to the camera, shape (N,).
            station: Whose camera it is.

        Returns:
            Red, green and blue, mostly within 0 to 255, shape (N, 3), float64.
        """
        slant = np.abs(normals @ self.sun)
        lit = self._lit(caster, places) if self.shadows else np.ones(len(places), dtype=bool)
        light = SHADE + (1 - SHADE) * lit * slant
        haze = 1 - np.exp(-3.912 / self.visibility * ranges)[:, None]  # Koschmieder's law
        seen: FloatArray = (1 - haze) * albedo * light[:, None] + haze * SKY
        return seen * self._gains(station)

    def _lit(self, caster: Any, places: FloatArray) -> FloatArray:
        """Whether the sun reaches each place (N,)."""
        toward = np.broadcast_to(self.sun, places.shape)
        rays = np.hstack([places + CLEARANCE * toward, toward]).astype(np.float32)
        hidden = caster.test_occlusions(open3d().core.Tensor.from_numpy(rays)).numpy()
        return np.logical_not(hidden).astype(np.float64)

    def _gains(self, station: int) -> FloatArray:
        """Exposure and white balance of a station, (3,)."""
        if station not in self.settings:
            exposure, balance = self.rng.normal(0.2, 0.12), self.rng.normal(0, 0.04, 3)
            self.settings[station] = np.exp(exposure + balance)
        return self.settings[station]
