"""The levels a network runs on: neighbor, decimation and interpolation indices.

Computed once, before the network, which then only gathers.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bushseg.compiled import compiled
from bushseg.config import Sampling
from bushseg.grid import BLOCK_BITS
from bushseg.neighbors import NeighborIndex
from bushseg.sampling import decimate, hash_uniform
from bushseg.stages import Stages


@dataclass(frozen=True, slots=True)
class Pyramid:
    """Indices of all levels; level l + 1 holds about a quarter of level l.

    Attributes:
        neighbors: Of each level: neighbor indices within it, (N_l, K) int32, nearest first.
        decimated: Of each level: its survivors, (N_{l+1},) int32, ascending.
        interpolated: Of each level: each point's nearest survivor, as an index into level l + 1,
            (N_l,) int32.
    """

    neighbors: tuple[NDArray[np.int32], ...]
    decimated: tuple[NDArray[np.int32], ...]
    interpolated: tuple[NDArray[np.int32], ...]

    @property
    def num_levels(self) -> int:
        """How many times the points are decimated."""
        return len(self.neighbors)


def build_pyramid(
    xyz: NDArray[np.float32],
    keys: NDArray[np.int64],
    *,
    num_neighbors: int,
    num_levels: int,
    decimation: int,
    sampling: Sampling,
    seed: int,
    stages: Stages | None = None,
) -> Pyramid:
    """Find the indices of all levels.

    Args:
        xyz: Positions relative to a nearby origin, Morton order, shape (N, 3), float32; N >= 1.
        keys: Voxel keys, from which decimation draws its zeta, shape (N,), int64.
        num_neighbors: K.
        num_levels: How many times to decimate.
        decimation: About one point in this many survives; at least one does.
        sampling: How survivors are chosen.
        seed: Selects the zeta.
        stages: Told of the time that neighbors and decimation take.

    Returns:
        The pyramid.
    """
    neighbors, decimated, interpolated = [], [], []
    stages = stages or Stages()
    index = NeighborIndex(xyz)
    for level in range(num_levels):
        points = index.points
        with stages.timed("neighbors"):
            around = index.query(points, num_neighbors)
        with stages.timed("decimation"):
            zeta = hash_uniform(keys, seed * num_levels + level)
            kept = decimate(zeta, keys >> (3 * BLOCK_BITS), decimation, points, around, sampling)
        with stages.timed("neighbors"):
            index = NeighborIndex(points[kept])
            interpolated.append(_nearest_survivors(points, around, kept, index))
        neighbors.append(around)
        decimated.append(kept)
        keys = keys[kept]
    return Pyramid(tuple(neighbors), tuple(decimated), tuple(interpolated))


def _nearest_survivors(
    points: NDArray[np.float32],
    neighbors: NDArray[np.int32],
    kept: NDArray[np.int32],
    survivors: NeighborIndex,
) -> NDArray[np.int32]:
    """Each point's nearest survivor: nearly always one of its neighbors, else sought for.

    Args:
        points: The level's positions, shape (N, 3), float32.
        neighbors: Their neighbors, nearest first, shape (N, K), int32.
        kept: The survivors, shape (M,), int32.
        survivors: The survivors, to be searched.

    Returns:
        Indices into the survivors, shape (N,), int32.
    """
    places = np.full(len(points), -1, dtype=np.int32)
    places[kept] = np.arange(len(kept), dtype=np.int32)
    nearest = np.empty(len(points), dtype=np.int32)
    _first_survivors(neighbors, places, nearest)
    missed = np.flatnonzero(nearest < 0)
    nearest[missed] = survivors.query(points[missed], 1)[:, 0]
    return nearest


@compiled
def _first_survivors(
    neighbors: NDArray[np.int32], places: NDArray[np.int32], nearest: NDArray[np.int32]
) -> None:
    """The first neighbor that has a place among the survivors; -1 where none has."""
    for i in range(len(neighbors)):
        nearest[i] = -1
        for j in range(neighbors.shape[1]):
            place = places[neighbors[i, j]]
            if place >= 0:
                nearest[i] = place
                break
