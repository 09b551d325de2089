"""A beam has a width: what it strikes in part, and what becomes one return."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.points import FloatArray
from bushseg.simulation.sensors.figures import Figures

EVENNESS = 0.01
"""A surface's ranges bend by less than so much, as a share of 1 m and the range, ray to ray."""


def ring(
    rng: np.random.Generator, origins: FloatArray, directions: FloatArray, figures: Figures
) -> tuple[FloatArray, FloatArray]:
    """Rays around the middle one of each beam, which with it carry equal shares of its light.

    They run at the median of what a Gaussian beam has outside the middle one's share; the beam's
    width (at 1/e^2) is the exit diameter and grows by the divergence.

    Args:
        rng: Turns the ring, so that it looks alike in no two beams.
        origins: Where M beams start, metres, shape (M, 3).
        directions: Unit vectors, shape (M, 3).
        figures: `sub_rays` (S, at least 2), `exit_diameter` and `divergence`.

    Returns:
        Origins and directions, each (M, S - 1, 3), float64. A direction reaches as far along the
        beam as the beam's own, so that distances along either are the same.
    """
    number = figures.sub_rays
    u, v = across(directions)
    radius = np.sqrt(-np.log((number - 1) / (2 * number)) / 2)
    angles = rng.uniform(0, 2 * np.pi, (len(directions), 1, 1))
    angles = angles + np.arange(number - 1)[:, None] * (2 * np.pi / (number - 1))
    offsets = radius / 2 * (np.cos(angles) * u[:, None] + np.sin(angles) * v[:, None])
    return (
        origins[:, None] + figures.exit_diameter * offsets,
        directions[:, None] + figures.divergence / 1000 * offsets,
    )


def near_edges(ranges: FloatArray) -> NDArray[np.bool_]:
    """Rays whose range doesn't lie in line with those sent before and after, (M,).

    Args:
        ranges: Metres, inf for nothing, in the order of sending, shape (M,).
    """
    before, after = np.roll(ranges, 1), np.roll(ranges, -1)
    with np.errstate(invalid="ignore"):  # inf - inf, where nothing is struck
        bend = np.abs(before - 2 * ranges + after)
        smooth = bend < EVENNESS * (1 + ranges)
    empty = np.isinf(before) & np.isinf(ranges) & np.isinf(after)
    return ~(smooth | empty)


def across(directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors, (M, 3) each, square to each of `directions` (M, 3) and to each other.

    Duff et al., "Building an Orthonormal Basis, Revisited" (2017).
    """
    x, y, z = directions.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    u = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return u, np.stack([b, sign + y * y * a, -y], axis=1)


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
