"""Minimum-probability random sampling, MRS (section 3.2, eq. 1-3), and plain random beside it.

Every point carries a probability zeta ~ U(0, 1). A draw takes the point with the smallest zeta as
its center, with its n nearest neighbors, and raises each of them by sqrt(1 - d_i / d_max) W: what
was just seen is seen again last. d is Euclidean, as printed; W is the share of the point's class in
the whole data set, so that common classes are put off longer and rare ones return sooner (1 where
there are no labels).

Two uses: drawing crops (:class:`ZetaQueue` keeps block minima, so that a draw's cost follows the
points it touches and not the points there are), and decimation between encoder layers
(:func:`decimate`).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.config import Sampling
from bushseg.decimation import decimate_mrs
from bushseg.scratch import Scratch

_BLOCK = 512
_RELEASED_AFTER = 64  # draws; each touches the pages of one tile at most


def raise_by_distance(
    distances: NDArray[Any], weights: NDArray[Any] | float = 1.0
) -> NDArray[np.float64]:
    """What a draw adds to the zeta of its points, eq. 3.

    Args:
        distances: Distance of each drawn point to the center, shape (..., n); the largest of each
            row is d_max. A row without extent (n = 1, duplicates) raises by the full weight.
        weights: W of each point, broadcast against `distances`.

    Returns:
        sqrt(1 - d / d_max) W, the shape of `distances`, float64.
    """
    d_max = distances.max(axis=-1, keepdims=True)
    ratio = np.divide(distances, d_max, out=np.zeros_like(distances), where=d_max > 0)
    return np.asarray(np.sqrt(1 - ratio) * weights, dtype=np.float64)


class ZetaQueue:
    """The zeta of many points, with the smallest at hand (eq. 1 and 2).

    Args:
        num_points: How many points.
        rng: Draws the first zeta.
        scratch: Holds them; None for memory.

    Raises:
        WriteError: The scratch folder can't hold them.
    """

    def __init__(
        self, num_points: int, rng: np.random.Generator, scratch: Scratch | None = None
    ) -> None:
        self.num_points = num_points
        self._scratch = scratch or Scratch()
        self._num_draws = 0
        size = -(-num_points // _BLOCK)
        self._zeta = self._scratch.empty("zeta", (size * _BLOCK,), np.float64)
        self._minima = np.empty(size)
        for rows in self._scratch.blocks(len(self._zeta)):
            part = self._zeta[rows]
            count = min(len(part), num_points - rows.start)
            part[:count], part[count:] = rng.random(count), np.inf
            minima = part.reshape(-1, _BLOCK).min(axis=1)
            self._minima[rows.start // _BLOCK : rows.stop // _BLOCK] = minima

    @property
    def zeta(self) -> NDArray[np.float64]:
        """The zeta of every point, shape (N,), float64; read only."""
        view = self._zeta[: self.num_points]
        view.flags.writeable = False
        return view

    def smallest(self) -> int:
        """Index of the point with the smallest zeta."""
        start = int(self._minima.argmin()) * _BLOCK
        return start + int(self._zeta[start : start + _BLOCK].argmin())

    def add(self, indices: NDArray[np.integer], amounts: NDArray[np.float64]) -> None:
        """Raise points.

        Args:
            indices: The points, each at most once, shape (n,).
            amounts: What each is raised by, not negative, shape (n,).
        """
        self._zeta[indices] += amounts
        touched = np.unique(indices // _BLOCK)
        self._minima[touched] = self._zeta.reshape(-1, _BLOCK)[touched].min(axis=1)
        self._num_draws += 1
        if self._num_draws % _RELEASED_AFTER == 0:
            self._scratch.release()


def hash_uniform(keys: NDArray[np.int64], seed: int) -> NDArray[np.float64]:
    """A number in [0, 1) for each key, the same whatever else there is.

    Decimation draws its zeta by voxel key, so that a voxel's fate doesn't depend on the tile it was
    seen in. The mixing is SplitMix64's finalizer (Steele et al., 2014).

    Args:
        keys: Voxel keys, shape (N,), int64.
        seed: Selects the sequence.

    Returns:
        Shape (N,), float64.
    """
    mixed = keys.view(np.uint64) + np.uint64((seed * 0x9E3779B97F4A7C15) % 2**64)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed ^= mixed >> np.uint64(31)
    return (mixed >> np.uint64(11)).astype(np.float64) * 2.0**-53


def decimate(
    zeta: NDArray[np.float64],
    cells: NDArray[np.int64],
    decimation: int,
    xyz: NDArray[np.float32],
    neighbors: NDArray[np.int32],
    sampling: Sampling = "mrs",
) -> NDArray[np.int32]:
    """Choose which points survive a layer: about one in `decimation`, none twice.

    MRS takes the points of smallest zeta in a few rounds; those taken in one round raise their K
    neighbors by eq. 3 (W = 1), so that the next round falls elsewhere. Plain random takes those
    whose zeta lies below 1 / decimation.

    What survives must not depend on what else is in the tile, or a label would depend on where the
    tile was cut. A smallest zeta among all points would; so it is sought in each cell of the voxel
    grid by itself, and a cell's share of survivors is rounded up or down by the zeta of its first
    point. Over all cells that gives one point in `decimation`, to within a few in a thousand.

    Args:
        zeta: U(0, 1) of each point, shape (N,), float64; left unchanged.
        cells: Cell of each point, ascending, shape (N,), int64.
        decimation: One in this many survives; at least one does.
        xyz: Positions, shape (N, 3), float32.
        neighbors: Neighbor indices, nearest first, shape (N, K), int32; where there are fewer than
            K points, each row names all and then repeats itself.
        sampling: "mrs" or "random".

    Returns:
        Indices of the survivors, ascending (Morton order is kept), shape (M,), int32.
    """
    if sampling == "random":
        kept = np.flatnonzero(zeta < 1 / decimation).astype(np.int32)
    else:
        kept = decimate_mrs(zeta, cells, decimation, xyz, neighbors)
    if not len(kept):
        kept = np.array([zeta.argmin()], dtype=np.int32)
    return kept
