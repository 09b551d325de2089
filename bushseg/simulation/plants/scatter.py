"""Where small plants stand: in clumps and patches, not evenly."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bushseg.points import FloatArray


def patches(rng: np.random.Generator, xy: FloatArray, size: float) -> FloatArray:
    """Smooth noise of about unit variance: plane waves of lengths about `size`, in all directions.

    Args:
        rng: Source of randomness.
        xy: Places in metres, shape (N, 2).
        size: Typical size of a patch, metres.

    Returns:
        Values, shape (N,), float64.
    """
    angles = rng.uniform(0, 2 * np.pi, 9)
    numbers = 2 * np.pi / (size * np.geomspace(0.4, 4, 9))
    amplitudes = 1 / np.sqrt(numbers)
    amplitudes *= np.sqrt(2 / np.sum(amplitudes**2))
    phase = xy @ (np.stack([np.cos(angles), np.sin(angles)]) * numbers)
    return np.sin(phase + rng.uniform(0, 2 * np.pi, 9)) @ amplitudes


def assigned(
    rng: np.random.Generator, xy: FloatArray, shares: Sequence[float], size: float
) -> NDArray[np.intp]:
    """Divide places among kinds so that a kind stands together in patches.

    Args:
        rng: Source of randomness.
        xy: Places in metres, shape (N, 2).
        shares: How much of the area each of K kinds wants, of any sum.
        size: Typical size of a patch, metres.

    Returns:
        A kind a place, shape (N,).
    """
    wanted = np.log(np.maximum(np.asarray(shares, np.float64), 1e-9))
    fields = np.stack([patches(rng, xy, size) for _ in shares], axis=1)
    # A little unevenness in itself lets kinds mix along their borders.
    fields += 0.25 * rng.standard_normal(fields.shape)
    chosen: NDArray[np.intp] = (wanted + fields).argmax(axis=1)
    return chosen


def scatter(
    rng: np.random.Generator,
    low: ArrayLike,
    high: ArrayLike,
    density: float,
    *,
    patch_size: float = 3.0,
    clumping: float = 1.0,
) -> FloatArray:
    """Draw places in a rectangle, closer together in some patches than in others.

    Args:
        rng: Source of randomness.
        low: Its corner of least x and y, metres, shape (2,).
        high: The opposite corner, metres, shape (2,).
        density: Places per square metre, on average.
        patch_size: Typical size of a patch, metres.
        clumping: 0 spreads places evenly; 2 leaves most of the area bare.

    Returns:
        Places, shape (N, 2), metres.
    """
    corner, edges = np.asarray(low, np.float64), np.subtract(high, low)
    number = round(density * float(np.prod(edges)))
    xy = corner + rng.uniform(0, 1, (3 * number, 2)) * edges
    liking = clumping * patches(rng, xy, patch_size) + rng.gumbel(size=len(xy))
    return xy[np.sort(np.argsort(-liking, kind="stable")[:number])]
