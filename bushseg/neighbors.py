"""Nearest neighbors, exact and the same whatever else is done with the points."""

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.neighbor_boxes import build_boxes
from bushseg.neighbor_search import search
from bushseg.parallel import for_chunks

_CHUNK = 4096  # queries a thread answers at a time


class NeighborIndex:
    """A set of points to be searched.

    Args:
        points: Positions, shape (N, 3), float32, relative to a nearby origin; N >= 1. Points in
            Morton order are searched several times as fast as shuffled ones.
    """

    def __init__(self, points: NDArray[np.float32]) -> None:
        self.points = np.ascontiguousarray(points)
        self._boxes = build_boxes(self.points)

    def query(self, queries: NDArray[np.float32], k: int) -> NDArray[np.int32]:
        """The k nearest points of each query, nearest first.

        Of points at equal distance, the one with the lower index comes first: between voxels in
        Morton order that is the one with the lower key, in whichever tile they are seen. Where the
        set holds fewer than k points, the neighbors found are repeated in turn, so that every row
        is full.

        Args:
            queries: Positions in the same frame, shape (M, 3), float32.
            k: How many neighbors, some dozens at most; a query that is one of the points finds
                itself first.

        Returns:
            Neighbor indices, shape (M, k), int32.
        """
        columns = np.ascontiguousarray(queries.T)
        found = np.empty((len(queries), k), dtype=np.int32)
        for_chunks(
            lambda start, stop: search(self._boxes, columns, start, stop, found),
            len(queries),
            _CHUNK,
        )
        return found


def nearest(
    points: NDArray[np.float32], center: NDArray[np.float32], k: int
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """The k points nearest to one place, by measuring all of them: for a k of hundreds or more.

    Args:
        points: Positions, shape (N, 3), float32.
        center: The place, shape (3,), float32.
        k: How many, at most N; of points at equal distance the first are taken.

    Returns:
        Their indices, ascending, shape (k,), int32; and their distances, shape (k,), float32.
    """
    squared = _square_distances(np.ascontiguousarray(points), center)
    farthest = np.partition(squared, k - 1)[k - 1]
    indices = np.flatnonzero(squared <= farthest).astype(np.int32)
    if len(indices) > k:  # several at the largest distance
        equal = np.flatnonzero(squared[indices] == farthest)
        indices = np.delete(indices, equal[k - len(indices) :])
    return indices, np.sqrt(squared[indices])


@compiled
def _square_distances(
    points: NDArray[np.float32], center: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Squared distance of each point to a place, shape (N,), float32."""
    squared = np.empty(len(points), np.float32)
    for i in range(len(points)):
        x, y, z = points[i, 0] - center[0], points[i, 1] - center[1], points[i, 2] - center[2]
        squared[i] = x * x + y * y + z * z
    return squared


@compiled
def reaches(xyz: NDArray[np.float32], neighbors: NDArray[np.int32]) -> NDArray[np.float32]:
    """Distance from the first to the last of each row's neighbors.

    Args:
        xyz: Positions, shape (N, 3), float32.
        neighbors: Indices of each point's neighbors, itself first, shape (M, K), int32.

    Returns:
        Shape (M,), float32.
    """
    found = np.empty(len(neighbors), np.float32)
    for i in range(len(neighbors)):
        first, last = neighbors[i, 0], neighbors[i, -1]
        x = xyz[last, 0] - xyz[first, 0]
        y = xyz[last, 1] - xyz[first, 1]
        z = xyz[last, 2] - xyz[first, 2]
        found[i] = np.sqrt(x * x + y * y + z * z)
    return found
