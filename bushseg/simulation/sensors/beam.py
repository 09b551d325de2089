"""A beam has a width: what it strikes in part, and what becomes one return."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.sensors.figures import Figures


def sub_rays(
    rng: np.random.Generator, origins: FloatArray, directions: FloatArray, figures: Figures
) -> tuple[FloatArray, FloatArray]:
    """Split each beam into rays that carry equal shares of its light.

    The first runs in the middle, the others around it, at the median of the rest of a Gaussian
    beam whose width (at 1/e^2) is the exit diameter and grows by the divergence.

    Args:
        rng: Turns the ring, so that it looks alike in no two beams.
        origins: Where M beams start, metres, shape (M, 3).
        directions: Unit vectors, shape (M, 3).
        figures: `sub_rays` (S), `exit_diameter` and `divergence`.

    Returns:
        Origins and directions, each (M, S, 3), float64. Directions are no longer than the beam's
        along the beam, so that distances along either are the same.
    """
    number = figures.sub_rays
    if number == 1:
        return origins[:, None], directions[:, None]
    u, v = across(directions)
    ring = np.sqrt(-np.log((number - 1) / (2 * number)) / 2)
    angles = rng.uniform(0, 2 * np.pi, (len(directions), 1))
    angles = angles + np.arange(number - 1) * (2 * np.pi / (number - 1))
    offsets = ring * (
        np.cos(angles)[..., None] * u[:, None] + np.sin(angles)[..., None] * v[:, None]
    )
    offsets = np.concatenate([np.zeros_like(offsets[:, :1]), offsets], axis=1)  # (M, S, 3)
    return (
        origins[:, None] + figures.exit_diameter / 2 * offsets,
        directions[:, None] + figures.divergence / 2000 * offsets,
    )


def across(directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors, (M, 3) each, square to each of `directions` (M, 3) and to each other."""
    reference = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(directions, reference)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(directions, u)


@dataclass(frozen=True, slots=True)
class Echoes:
    """What came back of M beams in N pieces, beam by beam, near before far.

    Attributes:
        beam: Which beam each is of, shape (N,), int64.
        range: Mean of what it is made of, by light, metres, shape (N,), float64.
        light: Reflectance times the cosine of incidence, times the share of the beam, shape (N,).
        cosine: Mean cosine of incidence, by light, shape (N,), float64.
        strongest: Which of the M x S sub-rays gave most of its light, shape (N,), int64.
    """

    beam: NDArray[np.int64]
    range: FloatArray
    light: FloatArray
    cosine: FloatArray
    strongest: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.beam)

    def take(self, kept: NDArray[np.intp] | NDArray[np.bool_]) -> "Echoes":
        """Some of them."""
        return Echoes(
            self.beam[kept],
            self.range[kept],
            self.light[kept],
            self.cosine[kept],
            self.strongest[kept],
        )


def group(
    ranges: FloatArray, reflectance: FloatArray, cosine: FloatArray, resolution: float
) -> Echoes:
    """Make one echo of all that lies no farther than `resolution` behind the thing before it.

    Args:
        ranges: What each sub-ray strikes, metres, inf for nothing, shape (M, S).
        reflectance: Of what it strikes, shape (M, S).
        cosine: Of the angle between ray and normal, shape (M, S).
        resolution: Metres.
    """
    number = ranges.shape[1]
    order = np.argsort(ranges, axis=1, kind="stable")
    near = np.take_along_axis(ranges, order, axis=1)
    struck = np.isfinite(near)
    apart = np.ones(ranges.shape, dtype=bool)
    with np.errstate(invalid="ignore"):  # inf - inf, where nothing is struck
        apart[:, 1:] = np.diff(near, axis=1) > resolution
    sub_ray = (order + np.arange(len(ranges))[:, None] * number)[struck]
    distance = near[struck]
    starts = np.flatnonzero(apart[struck])
    if not len(starts):
        none, nothing = np.zeros(0), np.zeros(0, np.int64)
        return Echoes(nothing, none, none, none, nothing)

    slant = cosine.ravel()[sub_ray]
    light = reflectance.ravel()[sub_ray] * slant / number
    weight = np.maximum(light, 1e-12)  # a grazed thing still lies somewhere
    total = np.add.reduceat(weight, starts)
    echo = np.repeat(np.arange(len(starts)), np.diff([*starts, len(distance)]))
    best = np.flatnonzero(weight == np.maximum.reduceat(weight, starts)[echo])
    best = best[np.unique(echo[best], return_index=True)[1]]
    return Echoes(
        beam=sub_ray[starts] // number,
        range=np.add.reduceat(weight * distance, starts) / total,
        light=np.add.reduceat(light, starts),
        cosine=np.add.reduceat(weight * slant, starts) / total,
        strongest=sub_ray[best],
    )


def select(echoes: Echoes, figures: Figures) -> Echoes:
    """Keep the echoes that the sensor tells of: the first few, the strongest or the last."""
    if not len(echoes):
        return echoes
    if figures.echo == "all":
        return echoes.take(ranks(echoes.beam) < figures.max_returns)
    starts = np.flatnonzero(np.diff(echoes.beam, prepend=-1))
    if figures.echo == "last":
        return echoes.take(np.append(starts[1:], len(echoes)) - 1)
    order = np.lexsort([-echoes.light / echoes.range**2, echoes.beam])
    return echoes.take(order[starts])


def ranks(beam: NDArray[np.int64]) -> NDArray[np.int64]:
    """The place of each echo in its beam, from 0; `beam` (N,) ascends."""
    starts = np.flatnonzero(np.diff(beam, prepend=-1))
    lengths = np.diff(np.append(starts, len(beam)))
    ascending: NDArray[np.int64] = np.arange(len(beam)) - np.repeat(starts, lengths)
    return ascending


def counts(beam: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many echoes each one's beam has; `beam` (N,) ascends."""
    starts = np.flatnonzero(np.diff(beam, prepend=-1))
    lengths = np.diff(np.append(starts, len(beam)))
    number: NDArray[np.int64] = np.repeat(lengths, lengths)
    return number
