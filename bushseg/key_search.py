"""Where keys stand among sorted ones, as compiled loops.

Points that follow each other in a scan lie near each other, and so do their keys: the search begins
where the last one ended and widens from there.
"""

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.parallel import for_chunks

_CHUNK = 65_536  # keys a thread takes at a time


def find_sorted(keys: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """Find keys.

    Args:
        keys: Ascending and unique, shape (N,), int64.
        wanted: Keys in any order, shape (M,), int64.

    Returns:
        Where each stands, shape (M,), int64; -1 for one that isn't there.
    """
    found = np.empty(len(wanted), dtype=np.int64)
    for_chunks(lambda start, stop: _find(keys, wanted, found, start, stop), len(wanted), _CHUNK)
    return found


@compiled
def _find(
    keys: NDArray[np.int64],
    wanted: NDArray[np.int64],
    found: NDArray[np.int64],
    start: int,
    stop: int,
) -> None:
    """Find keys start to stop."""
    size = len(keys)
    place = 0  # the first key that isn't below the last one wanted
    for i in range(start, stop):
        key = wanted[i]
        if place == size or keys[place] != key:
            place = _first_not_below(keys, key, place)
        found[i] = place if place < size and keys[place] == key else -1


@compiled
def _first_not_below(keys: NDArray[np.int64], key: int, near: int) -> int:
    """The first place whose key is not below a key, sought from a place outwards."""
    size, step = len(keys), 1
    if near < size and keys[near] < key:
        low = near + 1  # all before it are below
        high = low
        while high < size and keys[high] < key:
            low = high + 1
            high = min(size, high + step)
            step *= 2
    else:
        high = near  # it and all after it are not below
        low = high
        while low > 0 and keys[low - 1] >= key:
            high = low - 1
            low = max(0, low - step)
            step *= 2
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low
