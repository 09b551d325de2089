"""Nearest neighbors through Open3D's KD-tree."""

import numpy as np
from numpy.typing import NDArray

from bushseg.geometry import open3d


class NeighborIndex:
    """A KD-tree over a set of points.

    Args:
        points: Positions, shape (N, 3), float32, relative to a nearby origin; N >= 1. Points in
            Morton order are searched several times as fast as shuffled ones.
    """

    def __init__(self, points: NDArray[np.float32]) -> None:
        core = open3d().core
        self.points = np.ascontiguousarray(points)
        self._search = core.nns.NearestNeighborSearch(core.Tensor(self.points))
        self._search.knn_index()

    def query(self, queries: NDArray[np.float32], k: int) -> NDArray[np.int32]:
        """The k nearest points of each query, nearest first.

        Where the set holds fewer than k points, the neighbors found are repeated in turn, so that
        every row is full.

        Args:
            queries: Positions in the same frame, shape (M, 3), float32.
            k: How many neighbors; a query that is one of the points finds itself first.

        Returns:
            Neighbor indices, shape (M, k), int32.
        """
        available = min(k, len(self.points))
        core = open3d().core
        found, _ = self._search.knn_search(core.Tensor(np.ascontiguousarray(queries)), available)
        indices = found.numpy().reshape(len(queries), available).astype(np.int32)
        if available < k:
            indices = np.tile(indices, (1, -(-k // available)))[:, :k]
        return indices
