"""A tile's file: what is written comes back bit by bit; what was tampered with is refused."""

import os
import pickle
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.numpy import load_file, save_file

from bushseg.errors import CacheError
from bushseg.tile_data import CropSource, TileData
from bushseg.tile_files import load_crop_source, load_tile, save_tile

Loader = Callable[[Path], object]
LOADERS: list[Loader] = [load_tile, load_crop_source]


def make_tile(count: int = 50, seed: int = 0) -> TileData:
    rng = np.random.default_rng(seed)
    xyz = rng.normal(size=(count, 3)).astype(np.float32)
    keys = np.sort(rng.choice(10**12, count, replace=False))
    return TileData(
        origin=np.array([6_600_000.25, -0.1, 3.0]),
        indices=np.arange(count),
        is_core=rng.random(count) < 0.7,
        keys=keys,
        xyz=xyz,
        normals=rng.normal(size=(count, 3)).astype(np.float32),
        features={
            "rgb": rng.random((count, 3)).astype(np.float32),
            "height": rng.random((count, 1)).astype(np.float32),
        },
        labels=rng.integers(-1, 5, count).astype(np.int16),
        counts=rng.integers(1, 9, count).astype(np.int32),
    )


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "tile.safetensors"
    save_tile(path, make_tile())
    return path


@pytest.mark.parametrize("count", [1, 3, 300])
def test_a_tile_comes_back_bit_by_bit(tmp_path: Path, count: int) -> None:
    tile = make_tile(count)
    save_tile(tmp_path / "tile.safetensors", tile)
    loaded = load_tile(tmp_path / "tile.safetensors")
    columns = ("origin", "indices", "is_core", "keys", "xyz", "normals", "labels", "counts")
    pairs = [(getattr(tile, name), getattr(loaded, name)) for name in columns]
    pairs += [(tile.features[name], loaded.features[name]) for name in tile.features]
    for ours, theirs in pairs:
        assert ours.dtype == theirs.dtype
        assert ours.shape == theirs.shape
        assert ours.tobytes() == theirs.tobytes()
    assert loaded.features.keys() == tile.features.keys()


def test_what_crops_are_drawn_from_is_read_alone(saved: Path) -> None:
    tile, source = load_tile(saved), load_crop_source(saved)
    for name in CropSource.__slots__:
        np.testing.assert_array_equal(getattr(source, name), getattr(tile, name))
    indices = np.array([3, 8, 40], np.int32)
    assert source.take(indices).keys.tolist() == tile.keys[indices].tolist()


N = 50
CHANGES: dict[str, dict[str, Any]] = {
    "scalar positions": {"xyz": np.array(3, np.float32)},
    "flat positions": {"xyz": np.zeros((N, 2), np.float32)},
    "double positions": {"xyz": np.zeros((N, 3))},
    "too few positions": {"xyz": np.zeros((N - 1, 3), np.float32)},
    "float mask": {"is_core": np.ones(N)},
    "too many labels": {"labels": np.zeros(N + 1, np.int16)},
    "a short origin": {"origin": np.zeros(2)},
    "scalar keys": {"keys": np.array(1)},
    "a narrow feature": {"features.rgb": np.zeros((N, 2), np.float32)},
    "an unknown feature": {"features.smell": np.zeros((N, 1), np.float32)},
}


OF_CROPS = [change for change, new in CHANGES.items() if new.keys() & {*CropSource.__slots__}]


@pytest.mark.parametrize("change", CHANGES)
def test_a_tile_that_does_not_fit_itself_is_refused(saved: Path, change: str) -> None:
    save_file(load_file(saved) | CHANGES[change], saved)
    with pytest.raises(CacheError, match="prepare"):
        load_tile(saved)
    if change in OF_CROPS:
        with pytest.raises(CacheError, match="prepare"):
            load_crop_source(saved)
    else:
        assert len(load_crop_source(saved).xyz) == N


@pytest.mark.parametrize("name", ["xyz", "keys", "labels", "is_core", "origin"])
def test_a_tile_that_lacks_a_column_is_refused(saved: Path, name: str) -> None:
    tensors = load_file(saved)
    del tensors[name]
    save_file(tensors, saved)
    with pytest.raises(CacheError, match=name):
        load_tile(saved)
    if name != "origin":
        with pytest.raises(CacheError, match=name):
            load_crop_source(saved)


@pytest.mark.parametrize("load", LOADERS)
def test_a_pickle_is_never_opened(load: Loader, tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(tmp_path / "exploded"),)

    path = tmp_path / "tile.safetensors"
    path.write_bytes(pickle.dumps({"xyz": Bomb()}))
    with pytest.raises(CacheError, match="can't be read"):
        load(path)
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize("load", LOADERS)
def test_a_missing_file_is_named(load: Loader, tmp_path: Path) -> None:
    with pytest.raises(CacheError, match=r"nothing\.safetensors"):
        load(tmp_path / "nothing.safetensors")


@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_a_cut_or_flipped_file_is_refused_or_still_fits(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.safetensors"
    save_tile(path, make_tile(8))
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        path.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
        for load in LOADERS:
            with pytest.raises(CacheError):
                load(path)
        return
    # The header is where damage could do harm; a flipped value in a column can't be told.
    position = data.draw(st.integers(0, 900))
    content[position] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    with suppress(CacheError):
        source = load_crop_source(path)
        assert len(source.xyz) == len(source.labels) == len(source.keys)
    with suppress(CacheError):
        tile = load_tile(path)
        assert len(tile.normals) == len(tile.labels) == len(tile)
