"""Tensors on disk: safetensors files and JSON manifests, written whole or not at all.

Nothing is unpickled, lengths and dtypes are checked by safetensors itself, and names in a manifest
may not climb out of their folder.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from bushseg.errors import CacheError, WriteError
from bushseg.files import atomic_path
from bushseg.manifests import CropsManifest, ScanManifest, check_manifest
from bushseg.pyramid import Pyramid

FORMAT_VERSION = 4
"""Changes whenever prepared data of one version would be misread by another."""

KEY_DIGITS = 16
"""Hexadecimal digits of a :func:`fingerprint`, which names folders."""

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


def output_identity(path: Path) -> dict[str, Any]:
    """What tells an output from another: not its place, so that folders may be moved.

    Raises:
        OSError: There is none.
    """
    found = identity(path)
    del found["path"]
    return found


def fingerprint(values: Mapping[str, Any]) -> str:
    """A short hash of anything JSON can hold, the format version included."""
    text = json.dumps({"version": FORMAT_VERSION, **values}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_DIGITS]


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write a manifest.

    Raises:
        WriteError: The disk is full or the folder can't be written to.
    """
    try:
        with atomic_path(path) as partial:
            partial.write_text(json.dumps(values, indent=1), encoding="utf-8")
    except OSError as error:
        raise _refused(path, error) from error


def read_json(path: Path) -> dict[str, Any]:
    """Read a manifest.

    Raises:
        CacheError: It is missing, no JSON object, or of another format version.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CacheError(f"{path}: missing; run `bushseg prepare` first") from None
    except (OSError, ValueError, RecursionError) as error:  # numbers and depth without end, too
        raise CacheError(f"{path}: can't be read ({error}); run `bushseg prepare` again") from error
    if not isinstance(values, dict) or values.get("version") != FORMAT_VERSION:
        found = values.get("version") if isinstance(values, dict) else "no manifest"
        raise CacheError(
            f"{path}: version {found}; expected {FORMAT_VERSION}, run `bushseg prepare` again"
        )
    return values


def read_finished(
    path: Path, file_name: Callable[[int], str], kind: type[ScanManifest] | type[CropsManifest]
) -> dict[str, Any] | None:
    """Read a manifest if all that it lists is there.

    Args:
        path: The manifest; its "tiles" has an entry for each file beside it.
        file_name: Name of the file of an entry.
        kind: Which manifest it is.

    Returns:
        The manifest, or None where it is missing or damaged, or a file is missing.
    """
    try:
        manifest = read_json(path)
        num_files = len(check_manifest(kind, manifest, path).tiles)
    except CacheError:
        return None
    files = [path.with_name(file_name(number)) for number in range(num_files)]
    return manifest if all(file.exists() for file in files) else None


def member(folder: Path, name: object) -> Path:
    """A path inside a folder, from a name that a manifest gave.

    Raises:
        CacheError: The name is no plain relative path inside the folder.
    """
    path = folder / str(name)
    plain = isinstance(name, str) and "\0" not in name
    if not plain or not path.resolve().is_relative_to(folder.resolve()):
        raise CacheError(f"{folder}: its manifest names {name!r}, which lies outside the folder")
    return path


def save_tensors(path: Path, tensors: Mapping[str, NDArray[Any]]) -> None:
    """Write tensors as one safetensors file.

    Raises:
        WriteError: The disk is full or the folder can't be written to.
    """
    try:
        with atomic_path(path) as partial:
            save_file({name: np.ascontiguousarray(t) for name, t in tensors.items()}, partial)
    except (OSError, SafetensorError) as error:
        raise _refused(path, error) from error


def _refused(path: Path, error: Exception) -> WriteError:
    return WriteError(
        f"{path}: can't be written ({error}); make room on the disk, then give the same command "
        "again: it goes on from here"
    )


def load_tensors(path: Path) -> dict[str, NDArray[Any]]:
    """Read a safetensors file.

    Raises:
        CacheError: It is missing or damaged.
    """
    try:
        tensors: dict[str, NDArray[Any]] = load_file(path)
    except (OSError, SafetensorError, ValueError, TypeError, KeyError) as error:
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
    levels: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = []
    size = num_points
    while f"neighbors.{len(levels)}" in tensors:
        names = [f"{name}.{len(levels)}" for name in ("neighbors", "decimated", "interpolated")]
        try:
            neighbors, decimated, interpolated = (tensors[name] for name in names)
        except KeyError as error:
            raise CacheError(f"a cached tile lacks {error}; run `bushseg prepare` again") from error
        below = decimated.size
        _check_indices(neighbors, size, size, neighbors.size // max(size, 1))
        _check_indices(decimated, size, below)
        _check_indices(interpolated, below, size)
        levels.append((neighbors, decimated, interpolated))
        size = below
    return Pyramid(
        neighbors=tuple(level[0].astype(np.int32) for level in levels),
        decimated=tuple(level[1].astype(np.int32) for level in levels),
        interpolated=tuple(level[2].astype(np.int32) for level in levels),
    )


def _check_indices(indices: NDArray[Any], limit: int, *shape: int) -> None:
    """Check before the cast: a float or a wide integer would wrap into range."""
    fits = indices.dtype in (np.uint16, np.int32) and indices.shape == shape
    if not fits or (indices.size and not 0 <= indices.min() <= indices.max() < limit):
        raise CacheError("a cached tile's indices don't fit; run `bushseg prepare` again")
