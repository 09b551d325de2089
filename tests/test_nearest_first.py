"""Candidates in order of distance, against NumPy's stable sort."""

import numpy as np

from bushseg.nearest_first import MOST_RANKED, rank, sort_in


def test_few_and_many_candidates_are_sorted_alike() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        count, k = rng.integers(20, 200), rng.integers(1, 20)
        distances = rng.integers(0, 30, count).astype(np.float32)
        order = np.argsort(distances, kind="stable")[:k]
        inside = np.arange(1000, 1000 + count, dtype=np.int32)
        scratch = np.empty((2, MOST_RANKED), dtype=np.int32)
        room = np.append(distances, np.zeros(32, np.float32))
        for sort in (rank, sort_in):
            row = np.empty(k, dtype=np.int32)
            more = tuple(scratch) if sort is rank else ()
            assert sort(room.copy(), count, k, inside, row, *more) == distances[order[-1]]
            assert row.tolist() == inside[order].tolist()
