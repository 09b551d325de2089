"""Rays in batches, and what the sensor believes about them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from bushseg.points import FloatArray

BATCH_RAYS = 100_000

PULSE_RATE = 500_000.0
"""Rays a second, which gives the points their times."""


@dataclass(frozen=True, slots=True)
class Rays:
    """Some consecutive rays of one station, strip or frame.

    Where a ray goes is one thing, where its sensor thinks that it goes another: points are
    computed from the latter. That is how stations get out of register and paths drift, and how a
    frame comes to be in its sensor's own coordinates.

    Attributes:
        origins: Where they start, metres, shape (M, 3), float64.
        directions: Unit vectors, shape (M, 3), float64.
        reported_origins: Where they are thought to start, metres, shape (M, 3), float64.
        reported_directions: Where they are thought to go, unit vectors, shape (M, 3), float64.
        station: The station's number, from 1.
        first: The first ray's place among the station's rays.
    """

    origins: FloatArray
    directions: FloatArray
    reported_origins: FloatArray
    reported_directions: FloatArray
    station: int
    first: int

    @classmethod
    def exact(cls, origins: FloatArray, directions: FloatArray, station: int, first: int) -> Self:
        """Rays (M, 3) about which the sensor is right."""
        return cls(origins, directions, origins, directions, station, first)

    def __len__(self) -> int:
        return len(self.directions)


@dataclass(frozen=True, slots=True)
class Pose:
    """A place and an attitude.

    Attributes:
        position: Metres, shape (3,), float64.
        rotation: Turns forward, left and up into the world, shape (3, 3), float64.
    """

    position: FloatArray
    rotation: FloatArray

    def mistaken(self, rng: np.random.Generator, noise: float) -> "Pose":
        """The pose as a registration finds it, off by `noise` metres along each axis.

        Turned about the vertical as well, so far that points 30 m away are moved as much again.
        """
        shift, turn = noise * rng.standard_normal(3), noise / 30 * rng.standard_normal()
        return Pose(self.position + shift, about_z(turn) @ self.rotation)


def about_z(angle: float) -> FloatArray:
    """The rotation by `angle` radians about the vertical, (3, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def about_y(angle: float) -> FloatArray:
    """The rotation by `angle` radians about the left: forward goes down, (3, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])


def about_x(angle: float) -> FloatArray:
    """The rotation by `angle` radians about the direction of travel: left goes up, (3, 3)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


def cast_from(true: Pose, reported: Pose, local: FloatArray, station: int, first: int) -> Rays:
    """Rays of a sensor, given in its own coordinates.

    Args:
        true: Where the sensor is.
        reported: Where it is thought to be.
        local: Unit vectors: forward, left and up, shape (M, 3), float64.
        station: The station's number.
        first: The first ray's place among the station's.
    """
    return Rays(
        np.broadcast_to(true.position, local.shape),
        local @ true.rotation.T,
        np.broadcast_to(reported.position, local.shape),
        local @ reported.rotation.T,
        station,
        first,
    )


def spherical(azimuths: FloatArray, elevations: FloatArray) -> FloatArray:
    """Unit vectors (..., 3) of angles in degrees, of equal or fitting shapes."""
    azimuths, elevations = np.broadcast_arrays(np.radians(azimuths), np.radians(elevations))
    out = np.cos(elevations)
    return np.stack([np.cos(azimuths) * out, np.sin(azimuths) * out, np.sin(elevations)], axis=-1)
