"""The way that a carried or driven sensor goes."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from bushseg.points import FloatArray
from bushseg.simulation.sensors.figures import Figures
from bushseg.simulation.sensors.rays import Pose, about_x, about_y, about_z
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import Terrain

WHEELBASE = 2.0
"""Over so much ground a sensor's carrier levels out, metres."""

STRIDE = 0.7
"""Path over which a carrier bobs once, metres; twice as much to sway once."""

DRIFT_LENGTHS = (13.0, 31.0, 74.0)
"""Wavelengths of a path's slow errors, metres."""

GOLDEN_ANGLE = 2.399963


@dataclass(frozen=True, slots=True)
class Route:
    """A polyline over the ground, and how a sensor moves along it.

    Attributes:
        points: Corners, metres, shape (P, 2), float64.
        arcs: Path up to each of them, metres, shape (P,), float64.
        terrain: The ground.
        figures: Height, tilt, sway and bob of the sensor.
        rides: Whether it follows the ground's slope, as a vehicle does.
        phases: Where its movements and errors begin, radians, shape (8, 3), float64.
    """

    points: FloatArray
    arcs: FloatArray
    terrain: Terrain
    figures: Figures
    rides: bool
    phases: FloatArray

    @classmethod
    def of(cls, rng: np.random.Generator, site: Site, figures: Figures, *, rides: bool) -> Self:
        """The site's path; where it has none, from station to station."""
        points = np.asarray(site.path if len(site.path) > 1 else site.stations[:, :2], np.float64)
        if len(points) == 1:
            points = points + np.array([[-2.0, 0.0], [2.0, 0.0]])
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        arcs = np.concatenate([[0.0], np.cumsum(steps)])
        return cls(points, arcs, site.terrain, figures, rides, rng.uniform(0, 2 * np.pi, (8, 3)))

    @property
    def length(self) -> float:
        """The whole way, metres."""
        return float(self.arcs[-1])

    def place(self, arc: float) -> FloatArray:
        """Where the path is after `arc` metres, (2,); the ends are carried on nowhere."""
        return np.array([np.interp(arc, self.arcs, column) for column in self.points.T])

    def pose(self, arc: float, turn: int = 0) -> Pose:
        """Where the sensor is after `arc` metres, in its turn of that number."""
        figures, phases = self.figures, self.phases
        here = self.place(arc)
        ahead, behind = self.place(arc + WHEELBASE / 2), self.place(arc - WHEELBASE / 2)
        along = ahead - behind
        if not along.any():  # a path without length
            along = np.array([1.0, 0.0])
        heading = float(np.arctan2(along[1], along[0]))
        forward = along / np.linalg.norm(along)
        left = np.array([-forward[1], forward[0]])
        stride = 2 * np.pi * arc / STRIDE
        pitch, roll = np.radians(figures.sway) * np.sin(stride / 2 + phases[0, :2])
        if self.rides:
            half = WHEELBASE / 2
            rise = [float(self._height(here + half * way)) for way in (forward, -forward)]
            tip = [float(self._height(here + half * way)) for way in (left, -left)]
            pitch -= np.arctan2(rise[0] - rise[1], WHEELBASE)
            roll += np.arctan2(tip[0] - tip[1], WHEELBASE)
        place = here + figures.bob * np.sin(stride / 2 + phases[1, 0]) * left
        height = self._height(place) + figures.sensor_height
        height += figures.bob * np.sin(stride + phases[1, 1])
        rotation = about_z(heading) @ about_y(pitch) @ about_x(roll)
        if figures.tilt:  # the head leans ever elsewhere, so that its beams get everywhere
            rotation = (
                rotation @ about_z(GOLDEN_ANGLE * turn) @ about_y(float(np.radians(figures.tilt)))
            )
        return Pose(np.array([*place, height]), rotation)

    def believed(self, pose: Pose, arc: float) -> Pose:
        """Where the sensor is thought to be after `arc` metres: off by a slow drift."""
        noise = self.figures.registration_noise
        waves = [
            np.sin(2 * np.pi * arc / length + phase)
            for length, phase in zip(DRIFT_LENGTHS, self.phases[2:5], strict=True)
        ]
        shift = noise * np.sqrt(2 / len(waves)) * np.sum(waves, axis=0)
        turn = noise / 30 * np.sin(2 * np.pi * arc / DRIFT_LENGTHS[1] + self.phases[5, 0])
        return Pose(pose.position + shift, about_z(turn) @ pose.rotation)

    def _height(self, place: FloatArray) -> float:
        """The ground's height at `place` (2,), metres."""
        return float(self.terrain.height(place[None])[0])
