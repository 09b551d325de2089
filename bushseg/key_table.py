"""Which row a voxel key has: a hash table, as compiled loops.

Open addressing: a key's slot follows from the key; where it is taken, the next free one is used.
Slots hold row numbers, and the rows' keys stand in an array of their own. Keys of one cube of
4 x 4 x 4 voxels have slots side by side: points that follow each other in a scan are then found in
a cache line that was just read.
"""

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled

_CUBE_BITS = 6
_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2^64 over the golden ratio: spreads consecutive numbers


def empty_slots(num_rows: int) -> NDArray[np.int32]:
    """Slots for so many rows, all free; at most half of them will be taken."""
    return np.full(1 << max(_CUBE_BITS, (2 * num_rows - 1).bit_length()), -1, dtype=np.int32)


@compiled
def slot_of(slots: NDArray[np.int32], keys: NDArray[np.int64], key: int) -> int:
    """The slot that holds a key's row, or the free one where it would go."""
    mask = np.uint64(len(slots) - 1)
    cube, rest = np.uint64(key) >> np.uint64(_CUBE_BITS), np.uint64(key) & np.uint64(63)
    slot = (((cube * _MIX) >> np.uint64(32) << np.uint64(_CUBE_BITS)) + rest) & mask
    while slots[slot] >= 0 and keys[slots[slot]] != key:
        slot = (slot + np.uint64(1)) & mask
    return int(slot)


@compiled
def place(slots: NDArray[np.int32], keys: NDArray[np.int64]) -> None:
    """Enter rows, whose keys are unique, into free slots."""
    for row in range(len(keys)):
        slots[slot_of(slots, keys, keys[row])] = row
