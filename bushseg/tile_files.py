"""A prepared tile as a safetensors file, and what is read of it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from bushseg.cache import load_tensors, save_tensors
from bushseg.errors import CacheError
from bushseg.features import FEATURES
from bushseg.tile_data import CropSource, TileData

_AGAIN = "run `bushseg prepare` again"
_PREFIX = "features."


def save_tile(path: Path, tile: TileData) -> None:
    """Write a tile; what the scan's own order would need (`indices`) is left out."""
    tensors: dict[str, NDArray[Any]] = {
        "origin": tile.origin,
        "is_core": tile.is_core,
        "keys": tile.keys,
        "xyz": tile.xyz,
        "normals": tile.normals,
        "labels": tile.labels,
        "counts": tile.counts,
        **{_PREFIX + name: columns for name, columns in tile.features.items()},
    }
    save_tensors(path, tensors)


def load_tile(path: Path) -> TileData:
    """Read a tile.

    Raises:
        CacheError: It is missing, damaged or inconsistent.
    """
    columns = _Columns(path, load_tensors(path))
    size = columns.size
    names = [name.removeprefix(_PREFIX) for name in columns.tensors if name.startswith(_PREFIX)]
    if unknown := set(names) - FEATURES.keys():
        raise CacheError(f"{path}: has features {sorted(unknown)}, which nobody knows; {_AGAIN}")
    return TileData(
        origin=columns.take("origin", np.float64, 3),
        indices=np.arange(size),
        is_core=columns.take("is_core", np.bool_, size),
        keys=columns.take("keys", np.int64, size),
        xyz=columns.take("xyz", np.float32, size, 3),
        normals=columns.take("normals", np.float32, size, 3),
        features={
            name: columns.take(_PREFIX + name, np.float32, size, FEATURES[name]) for name in names
        },
        labels=columns.take("labels", np.int16, size),
        counts=columns.take("counts", np.int32, size),
    )


def load_crop_source(path: Path) -> CropSource:
    """Read what crops are drawn from of a tile, and no more: a third of it.

    Raises:
        CacheError: It is missing, damaged or inconsistent.
    """
    try:
        with safe_open(path, "numpy") as file:
            tensors = {name: file.get_tensor(name) for name in CropSource.__slots__}
    except (OSError, SafetensorError, ValueError, TypeError) as error:
        raise CacheError(f"{path}: can't be read ({error}); {_AGAIN}") from error
    columns = _Columns(path, tensors)
    size = columns.size
    return CropSource(
        is_core=columns.take("is_core", np.bool_, size),
        keys=columns.take("keys", np.int64, size),
        xyz=columns.take("xyz", np.float32, size, 3),
        labels=columns.take("labels", np.int16, size),
    )


class _Columns(NamedTuple):
    """A tile's tensors, checked as they are taken."""

    path: Path
    tensors: Mapping[str, NDArray[Any]]

    @property
    def size(self) -> int:
        """Voxels, by the keys."""
        return self._find("keys").size

    def take(self, name: str, dtype: type[np.generic], *shape: int) -> NDArray[Any]:
        """A column of this dtype and shape."""
        column = self._find(name)
        if column.dtype != dtype or column.shape != shape:
            raise CacheError(
                f"{self.path}: {name} is {column.shape} {column.dtype}, expected {shape} "
                f"{np.dtype(dtype)}; {_AGAIN}"
            )
        return column

    def _find(self, name: str) -> NDArray[Any]:
        if name not in self.tensors:
            raise CacheError(f"{self.path}: lacks {name!r}; {_AGAIN}")
        return self.tensors[name]
