"""Tensors on disk: what is written comes back bit by bit; what was tampered with is refused."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bushseg import cache
from bushseg.cache import (
    fingerprint,
    identity,
    load_tensors,
    member,
    pyramid_from_tensors,
    pyramid_tensors,
    read_json,
    save_tensors,
    write_json,
)
from bushseg.errors import CacheError
from bushseg.pyramid import build_pyramid


@pytest.mark.parametrize(("count", "dtype"), [(2**16, np.uint16), (2**16 + 1, np.int32)])
def test_indices_take_two_bytes_as_long_as_they_fit(count: int, dtype: type) -> None:
    xyz = np.random.default_rng(0).random((count, 3)).astype(np.float32)
    pyramid = build_pyramid(
        xyz,
        np.arange(count),
        num_neighbors=1,
        num_levels=1,
        decimation=16,
        sampling="random",
        seed=0,
    )
    tensors = pyramid_tensors(pyramid)
    assert tensors["neighbors.0"].dtype == dtype
    again = pyramid_from_tensors(tensors, count)
    np.testing.assert_array_equal(again.neighbors[0], pyramid.neighbors[0])


N = 50
INDEX_CHANGES: dict[str, dict[str, Any]] = {
    "a neighbor past the end": {"neighbors.0": np.full((N, 4), N, np.uint16)},
    "a negative neighbor": {"neighbors.0": np.full((N, 4), -1, np.int32)},
    "a neighbor that would wrap": {"neighbors.0": np.full((N, 4), 2**32, np.int64)},
    "neighbors that are no numbers": {"neighbors.0": np.full((N, 4), np.nan)},
    "neighbors without K": {"neighbors.0": np.zeros(N, np.uint16)},
    "scalar neighbors": {"neighbors.0": np.array(0, np.uint16)},
    "neighbors of other rows": {"neighbors.0": np.zeros((N - 1, 4), np.uint16)},
    "a survivor past the end": {"decimated.0": np.full(12, N, np.uint16)},
    "too few interpolated": {"interpolated.0": np.zeros(3, np.uint16)},
    "interpolated past the end": {"interpolated.0": np.full(N, 40, np.uint16)},
}


def indices_of(count: int) -> dict[str, NDArray[Any]]:
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(count, 3)).astype(np.float32)
    keys = np.sort(rng.choice(10**12, count, replace=False))
    pyramid = build_pyramid(
        xyz, keys, num_neighbors=4, num_levels=2, decimation=4, sampling="mrs", seed=0
    )
    return pyramid_tensors(pyramid)


@pytest.mark.parametrize("change", INDEX_CHANGES)
def test_indices_that_do_not_fit_are_refused(change: str) -> None:
    with pytest.raises(CacheError, match="prepare"):
        pyramid_from_tensors(indices_of(N) | INDEX_CHANGES[change], N)


@pytest.mark.parametrize("name", ["decimated.0", "interpolated.1"])
def test_a_level_that_lacks_indices_is_refused(name: str) -> None:
    tensors = indices_of(N)
    del tensors[name]
    with pytest.raises(CacheError, match="prepare"):
        pyramid_from_tensors(tensors, N)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CacheError, match=r"nothing\.safetensors"):
        load_tensors(tmp_path / "nothing.safetensors")
    with pytest.raises(CacheError, match="run `bushseg prepare` first"):
        read_json(tmp_path / "manifest.json")


def test_types_numpy_lacks_are_refused(tmp_path: Path) -> None:
    header = json.dumps({"xyz": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}}).encode()
    path = tmp_path / "tile.safetensors"
    path.write_bytes(len(header).to_bytes(8, "little") + header + b"\0\0")
    with pytest.raises(CacheError):
        load_tensors(path)


def test_strided_tensors_are_written_as_they_read(tmp_path: Path) -> None:
    table = np.arange(12).reshape(3, 4)
    save_tensors(tmp_path / "t.safetensors", {"turned": table.T, "every other": table[:, ::2]})
    loaded = load_tensors(tmp_path / "t.safetensors")
    np.testing.assert_array_equal(loaded["turned"], table.T)
    np.testing.assert_array_equal(loaded["every other"], table[:, ::2])


def test_a_manifest_comes_back(tmp_path: Path) -> None:
    values = {"version": cache.FORMAT_VERSION, "name": "Grünfläche", "tiles": [1, 2]}
    write_json(tmp_path / "deep" / "manifest.json", values)
    assert read_json(tmp_path / "deep" / "manifest.json") == values


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xfe",
        b"{",
        b"[]",
        b"3",
        b"{}",
        b'{"version": 999}',
        b'{"version": "1"}',
        b"[" * 100_000,
        b'{"version": ' + b"1" * 5000 + b"}",
    ],
)
def test_a_foreign_manifest_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "manifest.json"
    path.write_bytes(content)
    with pytest.raises(CacheError, match="again"):
        read_json(path)


@pytest.mark.parametrize(
    "name", ["../other", "/etc/passwd", "a/../../b", "..", "a\0b", None, 3, ["a"]]
)
def test_a_path_that_climbs_out_is_refused(tmp_path: Path, name: object) -> None:
    with pytest.raises(CacheError, match="outside"):
        member(tmp_path, name)


def test_a_link_that_leads_out_is_refused(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link").symlink_to(tmp_path)
    with pytest.raises(CacheError, match="outside"):
        member(inside, "link/secret")
    assert member(inside, "scans/a") == inside / "scans" / "a"


def test_fingerprints_follow_values_and_not_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    first = fingerprint({"a": 1, "b": [0.1, None]})
    assert first == fingerprint({"b": [0.1, None], "a": 1})
    assert first != fingerprint({"a": 1, "b": [0.1, 0]})
    monkeypatch.setattr(cache, "FORMAT_VERSION", cache.FORMAT_VERSION + 1)
    assert first != fingerprint({"a": 1, "b": [0.1, None]})


def test_identity_tells_a_changed_file(tmp_path: Path) -> None:
    path = tmp_path / "scan.las"
    path.write_bytes(b"a" * 200_000)
    os.utime(path, ns=(1, 1))
    first = identity(path)
    assert identity(path) == first
    os.utime(path, ns=(2, 2))
    assert identity(path) != first
    # Same size, same time, other last byte.
    path.write_bytes(b"a" * 199_999 + b"b")
    os.utime(path, ns=(1, 1))
    assert identity(path) != first
