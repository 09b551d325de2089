import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.compiled import compiled, compiled_fast
from bushseg.parallel import for_chunks, map_ahead, num_workers


@given(num_rows=st.integers(0, 200), size=st.integers(1, 50))
def test_chunks_cover_every_row_once(num_rows, size):
    seen = np.zeros(num_rows, dtype=int)

    def count(start, stop):
        assert stop - start <= size
        seen[start:stop] += 1

    for_chunks(count, num_rows, size)
    assert (seen == 1).all()


@pytest.mark.parametrize("num_rows", [1, 100])
def test_a_failing_chunk_is_raised(num_rows):
    def fail(start, stop):
        raise ValueError(f"rows {start} to {stop}")

    with pytest.raises(ValueError, match="rows 0"):
        for_chunks(fail, num_rows, 1 if num_rows == 1 else 100)
    with pytest.raises(ValueError, match="rows"):
        for_chunks(fail, num_rows, 10)


def test_there_is_at_least_one_worker():
    assert num_workers() >= 1


@given(count=st.integers(0, 60))
def test_results_come_in_the_order_of_their_items(count):
    assert list(map_ahead(lambda item: -item, range(count))) == [-item for item in range(count)]


def test_items_are_drawn_no_further_ahead_than_needed():
    drawn = itertools.count()
    results = map_ahead(lambda item: item, drawn)
    assert next(results) == 0
    results.close()
    assert next(drawn) <= 3 * num_workers() + 1


def test_an_item_that_fails_ends_it():
    done = []

    def work(item):
        if item == 3:
            raise ValueError("item 3")
        done.append(item)

    with pytest.raises(ValueError, match="item 3"):
        list(map_ahead(work, range(1000)))
    assert len(done) < 100


@compiled
def _exact(x):
    total = 0.0
    for value in x:
        total += value
    return total


@compiled_fast
def _fast(x):
    total = 0.0
    for value in x:
        total += value
    return total


def test_compiled_loops_sum_and_keep_nan():
    x = np.random.default_rng(0).random(1000)
    assert _exact(x) == np.add.accumulate(x)[-1]
    np.testing.assert_allclose(_fast(x), x.sum(), rtol=1e-12)
    assert np.isnan(_fast(np.array([1.0, np.nan])))
