"""Where a tripod stood, found from the order in which it saw things.

A simulated scan doesn't say where its stations were, but points come in columns of one azimuth:
seen from above, each column lies on a line through its station. The place nearest to all lines is
it. What moves while it scans has no such place, and none is found.
"""

import numpy as np
from numpy.typing import NDArray

NUM_COLUMNS = 1000
"""Slices of a station's time; about as many columns as a tripod scans."""

MIN_EXTENT = 2.0
"""Shorter lines point too vaguely, metres."""

MAX_MISS = 0.25
"""Half of the lines pass this near to a station, metres; else it moved."""

EYE_HEIGHT = 1.7
"""A tripod's height above the lowest points about it, metres."""


def find_stations(
    xyz: NDArray[np.float64], time: NDArray[np.float64], station: NDArray[np.integer]
) -> NDArray[np.float64] | None:
    """Find all stations of a scan.

    Args:
        xyz: Points, metres, (N, 3) float64.
        time: When each was seen, seconds, (N,) float64.
        station: From which station, (N,) integer.

    Returns:
        Their places, (S, 3) float64, about 0.1 m off; None if any of them moved.
    """
    found = []
    for number in np.unique(station):
        own = station == number
        place = _find(xyz[own], time[own])
        if place is None:
            return None
        found.append(place)
    return np.array(found)


def _find(xyz: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """One station's place, (3,)."""
    origin = xyz.mean(axis=0)
    span = max(float(np.ptp(time)), 1e-9)
    column = np.minimum(((time - time.min()) / span * NUM_COLUMNS).astype(int), NUM_COLUMNS - 1)
    middles, normals = _lines(xyz[:, :2] - origin[:2], column)
    # The place p with the least sum of (n . (p - middle))^2 over all lines.
    matrix = normals.T @ normals
    if len(normals) < 3 or np.linalg.cond(matrix) > 100:
        return None
    place = np.linalg.solve(matrix, normals.T @ np.einsum("ij,ij->i", normals, middles))
    misses = np.abs(np.einsum("ij,ij->i", normals, place - middles))
    if np.median(misses) > MAX_MISS:
        return None
    near = np.linalg.norm(xyz[:, :2] - origin[:2] - place, axis=1)
    around = xyz[np.argsort(near)[: max(1, len(xyz) // 100)], 2]
    return np.append(place + origin[:2], np.quantile(around, 0.1) + EYE_HEIGHT)


def _lines(
    xy: NDArray[np.float64], column: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The line along each column's points seen from above: its middle and its normal, (L, 2) each.

    The normal is the principal axis of the smaller spread; columns without extent are left out.
    """
    counts = np.bincount(column, minlength=NUM_COLUMNS).astype(np.float64)
    safe = np.maximum(counts, 1)
    middle = np.stack([np.bincount(column, values, NUM_COLUMNS) / safe for values in xy.T], axis=1)
    offset = xy - middle[column]
    xx, yy, both = (
        np.bincount(column, values, NUM_COLUMNS) / safe
        for values in (offset[:, 0] ** 2, offset[:, 1] ** 2, offset[:, 0] * offset[:, 1])
    )
    angle = 0.5 * np.arctan2(2 * both, xx - yy)
    normals = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    long = (counts >= 5) & (np.sqrt(xx + yy) >= MIN_EXTENT / 2)
    return middle[long], normals[long]
