"""The search behind :class:`bushseg.neighbors.NeighborIndex`, as compiled loops.

Points keep the order they come in. Runs of `LEAF` of them get a box each, `FAN` boxes one box
around them, and so on up to a single one: where the order keeps neighbors together, as Morton order
does, that is a tree as good as a KD-tree, and costs one pass to build.

Queries that follow each other closely are answered together. A radius is guessed from the answers
before; what lies in leaves within that radius of the group's box is copied side by side, so that
each query runs through it with vector instructions and keeps what lies within the radius. Where
that is fewer than k points, the radius is raised and the query asked again; so the answer is exact.

Loops over a constant number of boxes or points are written so that the compiler can use vector
registers: no condition inside, results written whether needed or not, the count raised if so.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled

LEAF = 8
FAN = 16

_GROUP = 16  # queries answered together
_REACH = 2.0  # a group's box may be so many radii wide
_SLACK = 1.5  # squared radius to try, over the mean of what the group before needed
_GROWTH = 2.25  # squared radius to try next, over the one that was too small
_RANKED = 256  # so many candidates are ranked against each other; more are sorted in one by one
_LARGEST = np.float32(3.4e38)
_SMALLEST = np.float32(1e-30)


class Boxes(NamedTuple):
    """Points in runs and the boxes around them.

    Attributes:
        points: x, y and z, shape (3, P), float32; P is N rounded up to whole leaves, and what is
            behind the last point is infinite.
        low: Lower corners of the boxes of all levels, leaves first, shape (3, B), float32. Each
            level is filled up to a multiple of `FAN` with boxes that nothing is near to.
        high: Upper corners, likewise.
        starts: Where each level begins, and the end, shape (levels + 1,), int64.
        radius: The squared radius to begin with: a typical leaf's diagonal, squared.
    """

    points: NDArray[np.float32]
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    starts: NDArray[np.int64]
    radius: np.float32


def build_boxes(points: NDArray[np.float32]) -> Boxes:
    """Box points in the order they come in.

    Args:
        points: Shape (N, 3), float32, finite, N >= 1. Others lead to wrong answers, not astray.
    """
    sizes = [-(-len(points) // LEAF)]
    while sizes[-1] > FAN:
        sizes.append(-(-sizes[-1] // FAN))
    starts = np.cumsum([0, *(-(-size // FAN) * FAN for size in sizes)])
    table = np.full((3, sizes[0] * LEAF), np.inf, dtype=np.float32)
    table[:, : len(points)] = points.T
    low = np.full((3, starts[-1]), np.inf, dtype=np.float32)
    high = np.full((3, starts[-1]), -np.inf, dtype=np.float32)
    _box_leaves(table, len(points), low, high)
    for level in range(1, len(sizes)):
        _box_boxes(low, high, starts[level - 1], starts[level], sizes[level])
    diagonals = ((high - low)[:, : sizes[0]].astype(np.float64) ** 2).sum(axis=0)
    radius = np.float32(min(np.median(diagonals), float(_LARGEST)))
    return Boxes(table, low, high, starts, radius)


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
    ranks, slots = np.empty(_RANKED, np.int32), np.empty(_RANKED, np.int32)
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
            num_leaves, side = _leaves_within(boxes, box, radius, lists, gaps)
            count = _copy_leaves(boxes.points, lists[side], num_leaves, near, numbers)
            again = 0
            for asked in range(left):
                query = group[asked]
                _square_distances(near, count, queries, query, squared)
                within = _keep_within(squared, count, radius, inside)
                if within < k and radius < _LARGEST:
                    group[again] = query
                    again += 1
                    continue
                for i in range(within):
                    distances[i] = squared[inside[i]]
                row = found[query]
                taken = min(k, within)
                if within <= _RANKED:
                    farthest = _rank(distances, within, taken, inside, row, ranks, slots)
                else:
                    farthest = _sort_in(distances, within, taken, inside, row)
                for i in range(taken):
                    row[i] = numbers[row[i]]
                for i in range(taken, k):
                    row[i] = row[i - taken] if taken else 0
                total += farthest
            left = again
            radius = min(radius * np.float32(_GROWTH), _LARGEST)
        guess = np.float32(min(total / size * _SLACK, _LARGEST))


@compiled
def _box_leaves(
    table: NDArray[np.float32],
    num_points: int,
    low: NDArray[np.float32],
    high: NDArray[np.float32],
) -> None:
    """Box each run of points."""
    for axis in range(3):
        for i in range(num_points):
            leaf = i // LEAF
            low[axis, leaf] = min(low[axis, leaf], table[axis, i])
            high[axis, leaf] = max(high[axis, leaf], table[axis, i])


@compiled
def _box_boxes(
    low: NDArray[np.float32], high: NDArray[np.float32], below: int, start: int, size: int
) -> None:
    """Box each run of the level below."""
    for axis in range(3):
        for box in range(size):
            first = below + box * FAN
            low[axis, start + box] = low[axis, first : first + FAN].min()
            high[axis, start + box] = high[axis, first : first + FAN].max()


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
def _leaves_within(
    boxes: Boxes,
    box: NDArray[np.float32],
    radius: np.float32,
    lists: NDArray[np.int32],
    gaps: NDArray[np.float32],
) -> tuple[int, int]:
    """The leaves that come within a squared radius of a box, ascending.

    Returns:
        How many, and which of the two lists holds them.
    """
    count, side = 1, 0
    lists[0, 0] = 0
    for level in range(len(boxes.starts) - 2, -1, -1):
        parents, children = lists[side], lists[1 - side]
        found = 0
        for i in range(count):
            first = parents[i] * FAN
            _square_gaps(boxes.low, boxes.high, boxes.starts[level] + first, box, gaps)
            for j in range(FAN):
                children[found] = first + j
                found += gaps[j] <= radius
        count, side = found, 1 - side
    return count, side


@compiled
def _square_gaps(
    low: NDArray[np.float32],
    high: NDArray[np.float32],
    first: int,
    box: NDArray[np.float32],
    gaps: NDArray[np.float32],
) -> None:
    """Squared distance of `FAN` boxes to a box; 0 where they overlap."""
    x0, y0, z0 = box[0, 0], box[0, 1], box[0, 2]
    x1, y1, z1 = box[1, 0], box[1, 1], box[1, 2]
    none = np.float32(0)
    for j in range(FAN):
        x = max(max(low[0, first + j] - x1, x0 - high[0, first + j]), none)
        y = max(max(low[1, first + j] - y1, y0 - high[1, first + j]), none)
        z = max(max(low[2, first + j] - z1, z0 - high[2, first + j]), none)
        gaps[j] = x * x + y * y + z * z


@compiled
def _copy_leaves(
    points: NDArray[np.float32],
    leaves: NDArray[np.int32],
    num_leaves: int,
    near: NDArray[np.float32],
    numbers: NDArray[np.int32],
) -> int:
    """Lay the points of some leaves side by side, with their numbers; returns how many."""
    for i in range(num_leaves):
        first, to = leaves[i] * LEAF, i * LEAF
        for j in range(LEAF):
            near[0, to + j] = points[0, first + j]
            near[1, to + j] = points[1, first + j]
            near[2, to + j] = points[2, first + j]
            numbers[to + j] = first + j
    return num_leaves * LEAF


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


@compiled
def _rank(
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
def _sort_in(
    distances: NDArray[np.float32],
    count: int,
    k: int,
    inside: NDArray[np.int32],
    row: NDArray[np.int32],
) -> np.float32:
    """As :func:`_rank`, for many: each is sorted into the k smallest so far, or dropped."""
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
