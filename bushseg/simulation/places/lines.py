"""Lines on the ground: ways, hedgerows, edges of woods."""

import numpy as np
from scipy.spatial import cKDTree

from bushseg.points import FloatArray


def winding(rng: np.random.Generator, size: float, bend: float, margin: float = 1.0) -> FloatArray:
    """Draw a smooth line across a site, from one edge to the opposite one.

    Args:
        rng: Source of randomness.
        size: Edge of the site, metres.
        bend: How far it strays from straight, as a share of `size`.
        margin: Its ends' distance from the site's edges, metres.

    Returns:
        Points about 1 m apart, shape (P, 2), metres.
    """
    along = np.linspace(margin, size - margin, max(round(size), 2))
    t = along / size
    across = size * rng.uniform(0.3, 0.7, 2) @ np.stack([1 - t, t])
    for waves in (1, 2, 3):
        phase = rng.uniform(0, 2 * np.pi)
        across += bend * size / (2 * waves) * np.sin(2 * np.pi * waves * t / 1.3 + phase)
    across = np.clip(across, 0.1 * size, 0.9 * size)
    line = np.stack([along, across], axis=1)
    if rng.random() < 0.5:
        line = line[:, ::-1]
    return np.ascontiguousarray(line[::-1] if rng.random() < 0.5 else line)


def loop(rng: np.random.Generator, size: float, share: float = 0.3) -> FloatArray:
    """Draw a closed line around a site's middle, its radius about `share` of `size`; (P, 2)."""
    angles = np.linspace(0, 2 * np.pi, max(round(2 * np.pi * share * size), 12))
    lobes = 1 + 0.2 * np.sin(2 * angles + rng.uniform(0, 6.28))
    lobes += 0.1 * np.sin(3 * angles + rng.uniform(0, 6.28))
    radius = np.minimum(share * size * lobes, 0.46 * size)
    angles = angles + rng.uniform(0, 2 * np.pi)
    return size / 2 + radius[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def directions(line: FloatArray) -> FloatArray:
    """Unit vectors along a line (P, 2) at its points; (P, 2)."""
    along = np.gradient(line, axis=0)
    unit: FloatArray = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return unit


def beside(line: FloatArray, distance: float) -> FloatArray:
    """A line (P, 2) moved `distance` metres to its left (to its right if negative); (P, 2)."""
    along = directions(line)
    return line + distance * np.stack([-along[:, 1], along[:, 0]], axis=1)


def spaced(line: FloatArray, spacing: float, start: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """Points every `spacing` metres of a line, from `start` metres on.

    Returns:
        The points (N, 2), metres, and the line's directions there in radians, shape (N,).
    """
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(start, reached[-1], spacing)
    points = np.stack([np.interp(at, reached, line[:, axis]) for axis in (0, 1)], axis=1)
    segment = np.clip(np.searchsorted(reached, at, side="right") - 1, 0, len(line) - 2)
    along = np.diff(line, axis=0)[segment]
    return points, np.arctan2(along[:, 1], along[:, 0])


def length(line: FloatArray) -> float:
    """A line's length, metres."""
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def stretch(line: FloatArray, low: float, high: float) -> FloatArray:
    """The part of a line (P, 2) between two shares of its length."""
    total = length(line)
    points, _ = spaced(line, max(total * (high - low) / 40, 0.5), low * total)
    return points[
        : max(int(np.ceil(total * (high - low) / max(total * (high - low) / 40, 0.5))), 2)
    ]


def nearest(line: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where places lie relative to a line.

    Args:
        line: Its points, metres, shape (P, 2).
        xy: Places, metres, shape (N, 2).

    Returns:
        Signed distances from the line, positive to its left (N,); the nearest points on the line
        (N, 2); how far along it these are (N,). All in metres.
    """
    line = line[np.concatenate([[True], np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9])]
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    reached = np.concatenate([[0.0], np.cumsum(steps)])
    # The nearest segment is one of the two at the nearest of points close to each other.
    count = np.maximum(np.ceil(steps / 0.5).astype(int), 1)
    owner = np.repeat(np.arange(len(steps)), count)
    t = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) / count[owner]
    dense = np.vstack([line[owner] + t[:, None] * np.diff(line, axis=0)[owner], line[-1:]])
    at = cKDTree(dense).query(xy)[1]
    owner = np.append(owner, len(steps) - 1)
    best = np.full(len(xy), np.inf)
    side, on, along = np.zeros(len(xy)), np.zeros((len(xy), 2)), np.zeros(len(xy))
    for segment in (owner[np.maximum(at - 1, 0)], owner[at]):
        a, way = line[segment], (line[1:] - line[:-1])[segment]
        share = np.clip(((xy - a) * way).sum(axis=1) / (way * way).sum(axis=1), 0, 1)
        foot = a + share[:, None] * way
        off = xy - foot
        distance = np.hypot(off[:, 0], off[:, 1])
        better = distance < best
        best = np.where(better, distance, best)
        on = np.where(better[:, None], foot, on)
        side = np.where(better, way[:, 0] * off[:, 1] - way[:, 1] * off[:, 0], side)
        along = np.where(better, reached[segment] + share * steps[segment], along)
    return np.where(side < 0, -1, 1) * best, on, along
