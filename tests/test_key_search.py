"""Keys found among sorted ones, against a dictionary."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.key_search import find_sorted

keys_in_use = st.lists(st.integers(0, 60) | st.integers(0, 2**63 - 1), unique=True, max_size=80)


@settings(deadline=None)
@given(keys=keys_in_use, wanted=st.lists(st.integers(-3, 65) | st.integers(0, 2**63 - 1)))
def test_keys_stand_where_a_dictionary_says(keys: list[int], wanted: list[int]) -> None:
    keys = sorted(keys)
    places = {key: row for row, key in enumerate(keys)}
    wanted = wanted + keys[::2] + keys[::-1] + keys[:1] * 3
    found = find_sorted(np.array(keys, dtype=np.int64), np.array(wanted, dtype=np.int64))
    assert found.dtype == np.int64
    assert found.tolist() == [places.get(key, -1) for key in wanted]


@pytest.mark.parametrize("in_order", [True, False])
def test_many_keys_are_found_by_all_threads(in_order: bool) -> None:
    rng = np.random.default_rng(0)
    keys = np.unique(rng.integers(0, 2**40, 100_000))
    rows = rng.integers(0, len(keys), 300_000)
    rows = np.sort(rows) if in_order else rows
    np.testing.assert_array_equal(find_sorted(keys, keys[rows]), rows)
