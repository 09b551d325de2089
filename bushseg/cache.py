"""Tensors on disk: safetensors files and JSON manifests, written whole or not at all.

Nothing is unpickled, lengths and dtypes are checked by safetensors itself, and names in a manifest
may not climb out of their folder.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from bushseg.errors import CacheError
from bushseg.files import atomic_path
from bushseg.pyramid import Pyramid
from bushseg.tile_data import TileData

FORMAT_VERSION = 2
"""Changes whenever prepared data of one version would be misread by another."""

_EDGE_BYTES = 65_536
_UINT16 = 2**16


def identity(path: Path) -> dict[str, Any]:
    """What tells whether a file has changed, without reading gigabytes.

    Returns:
        Its resolved path, size, modification time, and a hash of its first and last 64 KiB.
    """
    stat = path.stat()
    digest = hashlib.sha256()
    with path.open("rb") as file:
        digest.update(file.read(_EDGE_BYTES))
        file.seek(max(0, stat.st_size - _EDGE_BYTES))
        digest.update(file.read(_EDGE_BYTES))
    return {
        "path": str(path.resolve()),
        "size": stat.st_size,
        "modified_ns": stat.st_mtime_ns,
        "edges": digest.hexdigest(),
    }


def fingerprint(values: Mapping[str, Any]) -> str:
    """A short hash of anything JSON can hold, the format version included."""
    text = json.dumps({"version": FORMAT_VERSION, **values}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write a manifest."""
    with atomic_path(path) as partial:
        partial.write_text(json.dumps(values, indent=1), encoding="utf-8")


def read_json(path: Path) -> dict[str, Any]:
    """Read a manifest.

    Raises:
        CacheError: It is missing, no JSON object, or of another format version.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CacheError(f"{path}: missing; run `bushseg prepare` first") from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise CacheError(f"{path}: can't be read ({error}); run `bushseg prepare` again") from error
    if not isinstance(values, dict) or values.get("version") != FORMAT_VERSION:
        found = values.get("version") if isinstance(values, dict) else "no manifest"
        raise CacheError(
            f"{path}: version {found}; expected {FORMAT_VERSION}, run `bushseg prepare` again"
        )
    return values


def member(folder: Path, name: object) -> Path:
    """A path inside a folder, from a name that a manifest gave.

    Raises:
        CacheError: The name is no plain relative path inside the folder.
    """
    path = folder / str(name)
    if not isinstance(name, str) or not path.resolve().is_relative_to(folder.resolve()):
        raise CacheError(f"{folder}: its manifest names {name!r}, which lies outside the folder")
    return path


def save_tensors(path: Path, tensors: Mapping[str, NDArray[Any]]) -> None:
    """Write tensors as one safetensors file."""
    with atomic_path(path) as partial:
        save_file({name: np.ascontiguousarray(t) for name, t in tensors.items()}, partial)


def load_tensors(path: Path) -> dict[str, NDArray[Any]]:
    """Read a safetensors file.

    Raises:
        CacheError: It is missing or damaged.
    """
    try:
        tensors: dict[str, NDArray[Any]] = load_file(path)
    except (OSError, SafetensorError, ValueError) as error:
        raise CacheError(f"{path}: can't be read ({error}); run `bushseg prepare` again") from error
    return tensors


def pyramid_tensors(pyramid: Pyramid) -> dict[str, NDArray[Any]]:
    """A pyramid as named tensors; indices below 65,536 take two bytes."""
    tensors: dict[str, NDArray[Any]] = {}
    for level in range(pyramid.num_levels):
        size = len(pyramid.neighbors[level])
        dtype = np.uint16 if size <= _UINT16 else np.int32
        tensors[f"neighbors.{level}"] = pyramid.neighbors[level].astype(dtype)
        tensors[f"decimated.{level}"] = pyramid.decimated[level].astype(dtype)
        tensors[f"interpolated.{level}"] = pyramid.interpolated[level].astype(dtype)
    return tensors


def pyramid_from_tensors(tensors: Mapping[str, NDArray[Any]], num_points: int) -> Pyramid:
    """The inverse of :func:`pyramid_tensors`.

    Raises:
        CacheError: A level is missing, or an index points past its level.
    """
    parts: dict[str, list[NDArray[np.int32]]] = {
        "neighbors": [],
        "decimated": [],
        "interpolated": [],
    }
    level, size = 0, num_points
    while f"neighbors.{level}" in tensors:
        try:
            for name, column in parts.items():
                column.append(tensors[f"{name}.{level}"].astype(np.int32))
        except KeyError as error:
            raise CacheError(f"a cached tile lacks {error}; run `bushseg prepare` again") from error
        neighbors, decimated, interpolated = (column[-1] for column in parts.values())
        below = len(decimated)
        _check_indices(neighbors, size, size)
        _check_indices(decimated, size, below)
        _check_indices(interpolated, below, size)
        level, size = level + 1, below
    return Pyramid(*(tuple(column) for column in parts.values()))


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
        **{f"features.{name}": columns for name, columns in tile.features.items()},
        **pyramid_tensors(tile.pyramid),
    }
    save_tensors(path, tensors)


def load_tile(path: Path) -> TileData:
    """Read a tile.

    Raises:
        CacheError: It is missing, damaged or inconsistent.
    """
    tensors = load_tensors(path)
    prefix = "features."
    features = {n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)}
    try:
        xyz = tensors["xyz"]
        per_point = [tensors[name] for name in ("is_core", "keys", "normals", "labels", "counts")]
        if any(len(column) != len(xyz) for column in (*per_point, *features.values())):
            raise CacheError(f"{path}: columns differ in length; run `bushseg prepare` again")
        is_core, keys, normals, labels, counts = per_point
        return TileData(
            origin=tensors["origin"],
            indices=np.arange(len(xyz)),
            is_core=is_core,
            keys=keys,
            xyz=xyz,
            normals=normals,
            features=features,
            labels=labels,
            counts=counts,
            pyramid=pyramid_from_tensors(tensors, len(xyz)),
        )
    except KeyError as error:
        raise CacheError(f"{path}: lacks {error}; run `bushseg prepare` again") from error


def _check_indices(indices: NDArray[np.int32], limit: int, rows: int) -> None:
    if len(indices) != rows or (indices.size and not 0 <= indices.min() <= indices.max() < limit):
        raise CacheError("a cached tile's indices don't fit; run `bushseg prepare` again")
