"""A prepared data set, opened for training."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bushseg.cache import load_tensors, member, pyramid_from_tensors, read_json
from bushseg.config import TrainConfig
from bushseg.crops import CropSampler, class_weights, enough_crops
from bushseg.errors import CacheError, DataError
from bushseg.features import FEATURES
from bushseg.manifests import CropsManifest, DatasetManifest, check_manifest
from bushseg.prepared import DATASET, MANIFEST, crop_name, tile_name
from bushseg.pyramid import Pyramid
from bushseg.tile_data import NetworkTile, TileData
from bushseg.tile_files import load_tile
from bushseg.validation_split import hold_out

_OPEN_TILES = 48
_WHOLE_TILES = 16


@dataclass(frozen=True, slots=True)
class Sample:
    """One crop, ready to be augmented and fed to a network.

    Attributes:
        xyz: Metres from a nearby origin, (N, 3) float32.
        normals: Unit normals, (N, 3) float32.
        features: Feature name to (N, columns) float32.
        labels: Class index or -1, (N,) int64.
        pyramid: Indices of all levels.
    """

    xyz: NDArray[np.float32]
    normals: NDArray[np.float32]
    features: Mapping[str, NDArray[np.float32]]
    labels: NDArray[np.int64]
    pyramid: Pyramid


@dataclass(frozen=True, slots=True)
class TileEntry:
    """A tile of the data set.

    Attributes:
        scan: Index of its scan.
        path: Its file.
        core_size: Voxels in its core.
        class_counts: Labelled voxels per class in its core.
        neighbor_distance: Median distance to the K-th neighbor, metres.
        height_profile: Its 1 % and 99 % quantile of height, metres, and the share near the ground.
    """

    scan: int
    path: Path
    core_size: int
    class_counts: tuple[int, ...]
    neighbor_distance: float
    height_profile: tuple[float, float, float]


class Dataset:
    """What `prepare` wrote.

    Attributes:
        config: The settings it was prepared with.
        scheme: Its classes.
        features: Features that any of its scans has, in network order.
        partial_features: Those of them that some scans lack.
        scans: Each scan's path, as it was given to prepare.
        tiles: All tiles.
        crop_tiles: The tile of each cached crop.
        crop_labelled: Whether any point of each cached crop has a label.

    Args:
        folder: The data set's folder.

    Raises:
        CacheError: There is none, or it is damaged.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        place = self.folder / DATASET
        values = check_manifest(DatasetManifest, read_json(place), place)
        self.config, self.scheme = values.config, values.scheme
        self.features = tuple(name for name in FEATURES if name in values.features)
        self.partial_features = tuple(
            name
            for name in self.features
            if not all(name in scan.features for scan in values.scans)
        )
        self.scans = [scan.path for scan in values.scans]
        self.tiles = [
            TileEntry(
                scan=number,
                path=member(self.folder, scan.folder) / tile_name(index),
                core_size=tile.core_size,
                class_counts=tuple(tile.class_counts),
                neighbor_distance=tile.neighbor_distance,
                height_profile=_three(tile.height_profile),
            )
            for number, scan in enumerate(values.scans)
            for index, tile in enumerate(scan.tiles)
        ]
        self._crops = member(self.folder, values.crops)
        place = self._crops / MANIFEST
        drawn = check_manifest(CropsManifest, read_json(place), place)
        self.crop_tiles, self.crop_labelled = drawn.tiles, drawn.labelled
        if any(tile >= len(self.tiles) for tile in self.crop_tiles):
            raise CacheError(
                f"{place}: names tile {max(self.crop_tiles)} of {len(self.tiles)}; run "
                "`bushseg prepare` again"
            )
        self._open: OrderedDict[int, TileData] = OrderedDict()
        self._whole: OrderedDict[int, NetworkTile] = OrderedDict()

    def tile(self, number: int) -> TileData:
        """A tile by its index; the last few stay in memory.

        Raises:
            CacheError: Its file is missing or damaged.
        """
        tile = self._open.pop(number, None)
        if tile is None:
            tile = load_tile(self.tiles[number].path)
            self._check_tile(self.tiles[number], tile)
        self._open[number] = tile
        if len(self._open) > _OPEN_TILES:
            self._open.popitem(last=False)
        return tile

    def _check_tile(self, entry: TileEntry, tile: TileData) -> None:
        """Hold a tile against what the manifest says of it, which training counts on."""
        core = np.count_nonzero(tile.is_core)
        lowest, highest = int(tile.labels.min(initial=-1)), int(tile.labels.max(initial=-1))
        if core != entry.core_size or lowest < -1 or highest >= self.scheme.num_classes:
            raise CacheError(
                f"{entry.path}: {core:,} voxels in its core, labels {lowest} to {highest}; "
                f"expected {entry.core_size:,}, -1 to {self.scheme.num_classes - 1}; run `bushseg "
                "prepare` again"
            )

    def network_tile(self, number: int) -> NetworkTile:
        """A tile with its pyramid, which is found here; the last few stay in memory.

        Raises:
            CacheError: Its file is missing or damaged.
        """
        tile = self._whole.pop(number, None)
        if tile is None:
            tile = NetworkTile.of(self.tile(number), self.config)
        self._whole[number] = tile
        if len(self._whole) > _WHOLE_TILES:
            self._whole.popitem(last=False)
        return tile

    def cached_sample(self, number: int) -> Sample:
        """A crop that prepare drew.

        Raises:
            CacheError: Its file is missing or damaged.
        """
        tensors = load_tensors(self._crops / crop_name(number))
        tile = self.tile(self.crop_tiles[number])
        indices = tensors.pop("indices", np.empty(0))
        fits = indices.dtype == np.int32 and indices.ndim == 1 and len(indices) > 0
        if not fits or not 0 <= indices.min() <= indices.max() < len(tile):
            raise CacheError(
                f"crop {number} of {self._crops} doesn't fit its tile; run `bushseg prepare` again"
            )
        pyramid = pyramid_from_tensors(tensors, len(indices))
        levels, most = pyramid.num_levels, self.config.num_neighbors
        widths = {neighbors.shape[1] for neighbors in pyramid.neighbors}
        if levels != self.config.num_levels or max(widths, default=0) > most:
            raise CacheError(
                f"crop {number} of {self._crops} has {levels} levels of {sorted(widths)} neighbors,"
                f" not {self.config.num_levels} of up to {most}; run `bushseg prepare` again"
            )
        return self._sample(tile, indices, pyramid)

    def fresh_sample(self, number: int, indices: NDArray[np.int32]) -> Sample:
        """A crop drawn just now, some points of a tile; its pyramid is built here."""
        tile = self.tile(number)
        pyramid = tile.crop_pyramid(indices, self.config)
        return self._sample(tile, indices, pyramid)

    def sampler(self, tiles: Sequence[int], rng: np.random.Generator) -> CropSampler[TileData]:
        """Draws fresh crops from some of the tiles; its crops number the tiles as `tiles` does."""
        return CropSampler(
            [self.tiles[number].core_size for number in tiles],
            lambda index: self.tile(tiles[index]),
            self.config.crop_points,
            class_weights(self.class_counts(tiles)),
            rng,
        )

    def num_fresh(self, tiles: Sequence[int]) -> int:
        """How many fresh crops hold every point of these tiles about twice."""
        size = sum(self.tiles[number].core_size for number in tiles)
        return enough_crops(size, self.config.crop_points)

    def class_counts(self, tiles: Sequence[int]) -> NDArray[np.int64]:
        """Labelled voxels per class in some of the tiles, shape (C,)."""
        return np.sum([self.tiles[number].class_counts for number in tiles], axis=0, dtype=np.int64)

    def split(self, config: TrainConfig) -> tuple[list[int], list[int]]:
        """Which tiles train and which are held out: whole scans or whole tiles, never points.

        Tiles without labels are in neither.

        Returns:
            Tile indices to train on, and those held out.

        Raises:
            ConfigError: `validation` can't be understood or names no scan of the data set.
            DataError: Nothing labelled is left to train on.
        """
        usable = {n: tile.scan for n, tile in enumerate(self.tiles) if any(tile.class_counts)}
        held = hold_out(usable, self.scans, config)
        train = [number for number in usable if number not in held]
        if not train:
            raise DataError(
                f"{self.folder}: holds no labelled tile to train on ({len(self.tiles)} tiles, "
                f"{len(held)} held out); prepare labelled scans, or pass --validation none"
            )
        return train, sorted(held)

    @staticmethod
    def _sample(tile: TileData, indices: NDArray[np.int32], pyramid: Pyramid) -> Sample:
        return Sample(
            xyz=tile.xyz[indices],
            normals=tile.normals[indices],
            features={name: columns[indices] for name, columns in tile.features.items()},
            labels=tile.labels[indices].astype(np.int64),
            pyramid=pyramid,
        )


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    """Exactly three numbers."""
    first, second, third = map(float, values)
    return first, second, third
