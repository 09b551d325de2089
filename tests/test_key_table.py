"""Keys found in a hash table, against a dictionary."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.key_table import empty_slots, place, slot_of

# Neighboring keys, keys that differ in the highest bits alone, and the largest there is.
keys_in_use = st.lists(
    st.one_of(
        st.integers(0, 200),
        st.integers(0, 2**11 - 1).map(lambda high: high << 52),
        st.integers(0, 2**63 - 1),
    ),
    unique=True,
    max_size=120,
)


@settings(deadline=None)
@given(keys=keys_in_use, others=st.lists(st.integers(0, 2**63 - 1), max_size=30))
def test_keys_have_the_rows_a_dictionary_says(keys: list[int], others: list[int]) -> None:
    rows = {key: row for row, key in enumerate(keys)}
    placed = np.array(keys, dtype=np.int64)
    slots = empty_slots(len(keys))
    place(slots, placed)
    for key in keys + others:
        assert slots[slot_of(slots, placed, key)] == rows.get(key, -1)


@pytest.mark.parametrize("count", [0, 1, 31, 32, 33, 5000])
def test_slots_are_a_power_of_two_and_at_most_half_taken(count: int) -> None:
    slots = empty_slots(count)
    assert len(slots) >= max(64, 2 * count)
    assert len(slots) & (len(slots) - 1) == 0
    place(slots, np.arange(count))
    assert (slots >= 0).sum() == count


def test_keys_that_collide_go_to_the_next_free_slot() -> None:
    slots = empty_slots(3)
    keys = [
        key for key in range(0, 64 * 5000, 64) if slot_of(slots, np.empty(0, np.int64), key) == 0
    ]
    chosen = np.array(keys[:3])
    place(slots, chosen)
    assert slots[:4].tolist() == [0, 1, 2, -1]
    assert slots[slot_of(slots, chosen, keys[3])] == -1
