"""The nearest of some candidates, nearest first, as compiled loops.

Of candidates at equal distance the one that comes first is taken first.
"""

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled

MOST_RANKED = 256
"""So many candidates are ranked against each other; more are sorted in one by one."""


@compiled
def rank(
    distances: NDArray[np.float32],
    count: int,
    k: int,
    inside: NDArray[np.int32],
    row: NDArray[np.int32],
    ranks: NDArray[np.int32],
    slots: NDArray[np.int32],
) -> np.float32:
    """Write the k smallest in order; returns the k-th smallest.

    A candidate's rank is the number of those that are smaller. Equal ones share a rank: the first
    of them takes the place, and the empty places behind are the others', in order.

    Args:
        distances: Of the candidates, shape (at least `count` rounded up to 16,), float32.
        count: Candidates, at most `MOST_RANKED`.
        k: How many to write, at most `count`.
        inside: What each candidate is called, shape (at least `count`,), int32.
        row: Written to: what the k smallest are called, shape (at least k,), int32.
        ranks: Scratch, shape (MOST_RANKED,), int32.
        slots: Scratch, likewise.
    """
    padded = (count + 15) // 16 * 16
    for i in range(padded):
        ranks[i] = 0
    for j in range(count):
        distance = distances[j]
        for i in range(padded):
            ranks[i] += np.int32(distance < distances[i])
    for place in range(k):
        slots[place] = -1
    for i in range(count - 1, -1, -1):
        slots[ranks[i]] = i
    for place in range(k):
        if slots[place] < 0:
            i = slots[place - 1] + 1
            while ranks[i] != ranks[slots[place - 1]]:
                i += 1
            slots[place] = i
        row[place] = inside[slots[place]]
    return distances[slots[k - 1]] if k else np.float32(0)


@compiled
def sort_in(
    distances: NDArray[np.float32],
    count: int,
    k: int,
    inside: NDArray[np.int32],
    row: NDArray[np.int32],
) -> np.float32:
    """As :func:`rank`, for many: each is sorted into the k smallest so far, or dropped.

    `distances` are overwritten.
    """
    kept = 0
    for i in range(count):
        distance = distances[i]
        if kept < k or distance < distances[k - 1]:
            place = min(kept, k - 1)
            while place > 0 and distances[place - 1] > distance:
                distances[place], row[place] = distances[place - 1], row[place - 1]
                place -= 1
            distances[place], row[place] = distance, inside[i]
            kept = min(kept + 1, k)
    return distances[k - 1]
