"""Training crops drawn by minimum-probability random sampling over all tiles of a data set."""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from bushseg.neighbors import nearest
from bushseg.sampling import ZetaQueue, raise_by_distance
from bushseg.scratch import Scratch

OPEN_VOXELS = 1 << 22
"""Voxels, halos included, of the tiles that are held in memory at once while crops are drawn."""


class TilePoints(Protocol):
    """What a crop is drawn from; TileData has it."""

    @property
    def xyz(self) -> NDArray[np.float32]:
        """Positions, (N, 3) float32."""

    @property
    def is_core(self) -> NDArray[np.bool_]:
        """Whether each point belongs to the tile's core, (N,)."""

    @property
    def labels(self) -> NDArray[np.int16]:
        """Class index or -1, (N,)."""


Points = TypeVar("Points", bound=TilePoints)


@dataclass(frozen=True, slots=True)
class Crop:
    """A center's nearest points within one tile.

    Attributes:
        tile: Index of the tile.
        indices: The points, indices into the tile, ascending (Morton order), (n,) int32.
    """

    tile: int
    indices: NDArray[np.int32]


def class_weights(class_counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """W of eq. 3: each class's share of all labelled points.

    Args:
        class_counts: Labelled points per class, shape (C,).

    Returns:
        Shape (C + 1,), float64; the last entry, which label -1 selects, is 1, as is all of it where
        nothing is labelled.
    """
    total = class_counts.sum()
    shares = class_counts / total if total else np.ones(len(class_counts))
    return np.append(shares, 1.0)


class CropSampler(Generic[Points]):
    """Draws crops; each draw's center is the point least seen so far.

    Args:
        core_sizes: Core points of each tile, in the order of tile indices.
        load: Gives a tile's points by its index; called again for a tile that was put away.
        crop_points: n, points in a crop; a tile with fewer gives all it has.
        weights: W by class index, from :func:`class_weights`.
        rng: Draws the zeta.
        scratch: Holds the zeta; None for memory.
    """

    def __init__(
        self,
        core_sizes: Sequence[int],
        load: Callable[[int], Points],
        crop_points: int,
        weights: NDArray[np.float64],
        rng: np.random.Generator,
        scratch: Scratch | None = None,
    ) -> None:
        self._starts = np.concatenate([[0], np.cumsum(core_sizes)]).astype(np.int64)
        self._load = load
        self._crop_points = crop_points
        self._weights = weights
        self._open: OrderedDict[int, _OpenTile[Points]] = OrderedDict()
        self._num_open = 0
        self.queue = ZetaQueue(int(self._starts[-1]), rng, scratch)

    def draw(self) -> Crop:
        """Take the point with the smallest zeta and its nearest neighbors; raise them by eq. 3.

        Points of the halo are part of the crop but carry no zeta: they have one in their own tile.
        """
        center = self.queue.smallest()
        number = int(np.searchsorted(self._starts, center, side="right")) - 1
        tile = self._tile(number)
        position = tile.core[center - self._starts[number]]
        point = tile.points.xyz[position]
        size = min(self._crop_points, len(tile.points.xyz))
        drawn, distances = nearest(tile.points.xyz, point, size)
        raised = raise_by_distance(distances, self._weights[tile.points.labels[drawn]])
        inner = tile.points.is_core[drawn]
        in_core = np.searchsorted(tile.core, drawn[inner])
        self.queue.add(self._starts[number] + in_core, raised[inner])
        return Crop(number, drawn)

    def draws(self, count: int) -> Iterator[Crop]:
        """Draw so many crops."""
        for _ in range(count):
            yield self.draw()

    def points(self, number: int) -> Points:
        """A tile's points; those of the last draw's tile are in memory."""
        return self._tile(number).points

    def _tile(self, number: int) -> "_OpenTile[Points]":
        """A tile; the least recently used are put away."""
        tile = self._open.pop(number, None)
        if tile is None:
            points = self._load(number)
            tile = _OpenTile(points, np.flatnonzero(points.is_core))
            self._num_open += len(points.xyz)
        self._open[number] = tile
        while self._num_open > OPEN_VOXELS and len(self._open) > 1:
            _, closed = self._open.popitem(last=False)
            self._num_open -= len(closed.points.xyz)
        return tile


@dataclass(frozen=True, slots=True)
class _OpenTile(Generic[Points]):
    """A tile held in memory: its points, and which of them are core."""

    points: Points
    core: NDArray[np.intp]


def enough_crops(num_points: int, crop_points: int) -> int:
    """How many crops hold every point about twice."""
    return max(1, -(-2 * num_points // crop_points))
