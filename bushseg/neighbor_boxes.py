"""Points in boxes, and the boxes in boxes: which points are near a place, as compiled loops.

Points keep the order they come in. Runs of `LEAF` of them get a box each, `FAN` boxes one box
around them, and so on up to a single one: where the order keeps neighbors together, as Morton order
does, that is a tree as good as a KD-tree, and costs one pass to build.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled

LEAF = 8
FAN = 16

LARGEST = np.float32(3.4e38)
"""The largest squared distance there is."""


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
    radius = np.float32(min(np.median(diagonals), float(LARGEST)))
    return Boxes(table, low, high, starts, radius)


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
def leaves_within(
    boxes: Boxes,
    box: NDArray[np.float32],
    radius: np.float32,
    lists: NDArray[np.int32],
    gaps: NDArray[np.float32],
) -> tuple[int, int]:
    """The leaves that come within a squared radius of a box, ascending.

    Args:
        boxes: All boxes.
        box: Lower and upper corner, shape (2, 3), float32.
        radius: The radius, squared.
        lists: Written to: numbers of boxes, level after level, shape (2, at least B + FAN), int32.
        gaps: Scratch, shape (FAN,), float32.

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
def copy_leaves(
    points: NDArray[np.float32],
    leaves: NDArray[np.int32],
    num_leaves: int,
    near: NDArray[np.float32],
    numbers: NDArray[np.int32],
) -> int:
    """Lay the points of some leaves side by side, with their numbers; returns how many.

    Args:
        points: x, y and z, as :class:`Boxes` has them.
        leaves: Which leaves, shape (at least `num_leaves`,), int32.
        num_leaves: How many of them.
        near: Written to: x, y and z, shape (3, P), float32.
        numbers: Written to: the points' indices, shape (P,), int32.
    """
    for i in range(num_leaves):
        first, to = leaves[i] * LEAF, i * LEAF
        for j in range(LEAF):
            near[0, to + j] = points[0, first + j]
            near[1, to + j] = points[1, first + j]
            near[2, to + j] = points[2, first + j]
            numbers[to + j] = first + j
    return num_leaves * LEAF
