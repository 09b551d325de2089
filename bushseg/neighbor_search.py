"""The search behind :class:`bushseg.neighbors.NeighborIndex`, as compiled loops.

Queries that follow each other closely are answered together. A radius is guessed from the answers
before; what lies in leaves within that radius of the group's box is copied side by side, so that
each query runs through it with vector instructions and keeps what lies within the radius. Where
that is fewer than k points, the radius is raised and the query asked again; so the answer is exact.

Loops over a constant number of boxes or points are written so that the compiler can use vector
registers: no condition inside, results written whether needed or not, the count raised if so.
"""

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.nearest_first import MOST_RANKED, rank, sort_in
from bushseg.neighbor_boxes import FAN, LARGEST, Boxes, copy_leaves, leaves_within

_GROUP = 16  # queries answered together
_REACH = 2.0  # a group's box may be so many radii wide
_SLACK = 1.5  # squared radius to try, over the mean of what the group before needed
_GROWTH = 2.25  # squared radius to try next, over the one that was too small
_SMALLEST = np.float32(1e-30)


@compiled
def search(
    boxes: Boxes,
    queries: NDArray[np.float32],
    start: int,
    stop: int,
    found: NDArray[np.int32],
) -> None:
    """Write the nearest points of queries start to stop into their rows of `found`.

    Nearest first; of points at equal distance the one that comes first. Where fewer than k points
    lie at a finite distance, those that do are repeated; a query that has none gets the first.

    Args:
        boxes: The points.
        queries: x, y and z, shape (3, M), float32.
        start: First query.
        stop: Query after the last.
        found: Shape (M, k), int32.
    """
    k = found.shape[1]
    capacity = boxes.points.shape[1]
    lists = np.empty((2, boxes.low.shape[1] + FAN), np.int32)
    near, squared = np.empty((3, capacity), np.float32), np.empty(capacity, np.float32)
    numbers, inside = np.empty(capacity, np.int32), np.empty(capacity + 1, np.int32)
    distances = np.empty(capacity + 32, np.float32)
    ranks, slots = np.empty(MOST_RANKED, np.int32), np.empty(MOST_RANKED, np.int32)
    gaps, box = np.empty(FAN, np.float32), np.empty((2, 3), np.float32)
    group = np.empty(_GROUP, np.int64)
    guess, least = boxes.radius, max(boxes.radius * np.float32(1e-3), _SMALLEST)
    at = start
    while at < stop:
        size = _gather_group(queries, at, stop, _REACH * np.sqrt(guess), group)
        at += size
        radius, left, total = np.float32(max(guess, least)), size, np.float32(0)
        while left:
            _box_queries(queries, group, left, box)
            num_leaves, side = leaves_within(boxes, box, radius, lists, gaps)
            count = copy_leaves(boxes.points, lists[side], num_leaves, near, numbers)
            again = 0
            for asked in range(left):
                query = group[asked]
                _square_distances(near, count, queries, query, squared)
                within = _keep_within(squared, count, radius, inside)
                if within < k and radius < LARGEST:
                    group[again] = query
                    again += 1
                    continue
                for i in range(within):
                    distances[i] = squared[inside[i]]
                row = found[query]
                taken = min(k, within)
                if within <= MOST_RANKED:
                    farthest = rank(distances, within, taken, inside, row, ranks, slots)
                else:
                    farthest = sort_in(distances, within, taken, inside, row)
                for i in range(taken):
                    row[i] = numbers[row[i]]
                for i in range(taken, k):
                    row[i] = row[i - taken] if taken else 0
                total += farthest
            left = again
            radius = min(radius * np.float32(_GROWTH), LARGEST)
        guess = np.float32(min(total / size * _SLACK, LARGEST))


@compiled
def _gather_group(
    queries: NDArray[np.float32],
    start: int,
    stop: int,
    reach: float,
    group: NDArray[np.int64],
) -> int:
    """How many queries from `start` on lie in a box of edge `reach`; at least one."""
    low0 = high0 = queries[0, start]
    low1 = high1 = queries[1, start]
    low2 = high2 = queries[2, start]
    size = 0
    while size < _GROUP and start + size < stop:
        x, y, z = queries[0, start + size], queries[1, start + size], queries[2, start + size]
        low0, low1, low2 = min(low0, x), min(low1, y), min(low2, z)
        high0, high1, high2 = max(high0, x), max(high1, y), max(high2, z)
        fits = high0 - low0 <= reach and high1 - low1 <= reach and high2 - low2 <= reach
        if size and not fits:
            break
        group[size] = start + size
        size += 1
    return size


@compiled
def _box_queries(
    queries: NDArray[np.float32], group: NDArray[np.int64], size: int, box: NDArray[np.float32]
) -> None:
    """The box around a group's queries."""
    for axis in range(3):
        low = high = queries[axis, group[0]]
        for i in range(1, size):
            low = min(low, queries[axis, group[i]])
            high = max(high, queries[axis, group[i]])
        box[0, axis], box[1, axis] = low, high


@compiled
def _square_distances(
    near: NDArray[np.float32],
    count: int,
    queries: NDArray[np.float32],
    query: int,
    squared: NDArray[np.float32],
) -> None:
    """Squared distance of each candidate to a query."""
    x, y, z = queries[0, query], queries[1, query], queries[2, query]
    for j in range(count):
        dx, dy, dz = near[0, j] - x, near[1, j] - y, near[2, j] - z
        squared[j] = dx * dx + dy * dy + dz * dz


@compiled
def _keep_within(
    squared: NDArray[np.float32], count: int, radius: np.float32, inside: NDArray[np.int32]
) -> int:
    """Which candidates lie within a squared radius, ascending; returns how many."""
    kept = 0
    for j in range(count):
        inside[kept] = j
        kept += squared[j] <= radius
    return kept
