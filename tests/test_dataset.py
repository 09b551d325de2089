import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from bushseg.config import TrainConfig
from bushseg.dataset import Dataset
from bushseg.errors import CacheError, ConfigError, DataError
from bushseg.preparation import prepare


@pytest.fixture
def copy(prepared, tmp_path) -> Path:
    return shutil.copytree(prepared, tmp_path / "copy")


@pytest.fixture(scope="module")
def dataset(prepared) -> Dataset:
    return Dataset(prepared)


def split(dataset: Dataset, validation: str, **settings) -> tuple[list[int], list[int]]:
    return dataset.split(TrainConfig(validation=validation, **settings))


def scans_of(dataset: Dataset, tiles: list[int]) -> set[str]:
    return {Path(dataset.scans[dataset.tiles[number].scan]).stem for number in tiles}


def test_what_prepare_wrote(dataset):
    assert dataset.features == ("rgb", "intensity", "height")
    assert [Path(scan).stem for scan in dataset.scans] == ["middle", "north", "south"]
    assert len(dataset.tiles) > len(dataset.scans)  # each is cut into several
    for number, entry in enumerate(dataset.tiles):
        tile = dataset.tile(number)
        assert tile.is_core.sum() == entry.core_size
        counts = np.bincount(tile.labels[tile.labels >= 0], minlength=7)
        assert counts.tolist() == list(entry.class_counts)


def test_class_counts_add_up(dataset):
    everything = range(len(dataset.tiles))
    counts = dataset.class_counts(everything)
    assert counts.tolist() == np.sum([t.class_counts for t in dataset.tiles], axis=0).tolist()
    assert np.flatnonzero(counts).tolist() == [0, 2, 4]


def test_a_tile_for_the_network_has_a_pyramid_and_stays_in_memory(dataset, monkeypatch):
    tile = dataset.network_tile(0)
    assert [len(level) for level in tile.pyramid.neighbors[:1]] == [len(dataset.tile(0))]
    assert dataset.network_tile(0) is tile
    monkeypatch.setattr("bushseg.dataset._WHOLE_TILES", 1)
    dataset.network_tile(1)
    assert dataset.network_tile(0) is not tile


def test_cached_crops_are_points_of_their_tile(dataset):
    for number in range(len(dataset.crop_tiles)):
        sample = dataset.cached_sample(number)
        assert len(sample.xyz) == 512
        assert sample.labels.dtype == np.int64
        tile = dataset.tile(dataset.crop_tiles[number])
        assert set(map(bytes, sample.xyz)) <= set(map(bytes, tile.xyz))
        assert sample.pyramid.num_levels == 2
        assert len(sample.pyramid.neighbors[0]) == len(sample.features["rgb"]) == 512


def test_fresh_crops_come_from_the_tiles_asked_for(dataset):
    tiles = [1, 3]
    sampler = dataset.sampler(tiles, np.random.default_rng(0))
    for crop in sampler.draws(4):
        sample = dataset.fresh_sample(tiles[crop.tile], crop.indices)
        assert len(sample.xyz) == len(crop.indices) == sample.pyramid.neighbors[0].shape[0]


@pytest.mark.parametrize("validation", ["auto", "tile", "none", "scan:north", "scan:north, south"])
def test_no_tile_is_in_both(dataset, validation):
    train, held = split(dataset, validation)
    assert train
    assert not set(train) & set(held)
    assert sorted(train + held) == list(range(len(dataset.tiles)))


def test_everything_held_out(dataset):
    with pytest.raises(DataError, match="no labelled tile"):
        split(dataset, "scan:north,middle,south")


def test_scans_without_labels_are_in_neither_part(new_scene, write_las, tiny, tmp_path):
    # A .txt scan has labels only if a .labels stands beside it.
    labelled = write_las(tmp_path / "labelled.las", new_scene(0))
    bare = tmp_path / "bare.txt"
    scene = new_scene(1)
    np.savetxt(bare, np.column_stack([scene.xyz, scene.intensity, scene.rgb // 256]), fmt="%.3f")
    prepare([labelled, bare], tmp_path / "data", tiny().prepare)
    dataset = Dataset(tmp_path / "data")
    train, held = split(dataset, "tile")
    assert scans_of(dataset, train + held) == {"labelled"}
    with pytest.raises(ConfigError, match=r"bare.*no labels"):
        split(dataset, "scan:bare")
    prepare([bare], tmp_path / "data", tiny().prepare)
    with pytest.raises(DataError, match="no labelled tile"):
        split(Dataset(tmp_path / "data"), "auto")


def test_no_data_set(tmp_path):
    with pytest.raises(CacheError, match="bushseg prepare"):
        Dataset(tmp_path / "nowhere")


@pytest.mark.parametrize(
    "change",
    [
        {"version": 99},
        {"config": {"voxel_size": -1}},
        {"scheme": {}},
        {"scans": [{}]},
        {"scans": 7},
        {"scans": [], "crops": "crops"},
        {"crops": "../elsewhere"},
        {"features": None},
    ],
)
def test_a_damaged_manifest(copy, change):
    path = copy / "dataset.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(CacheError):
        Dataset(copy)


@pytest.mark.parametrize(
    "change", [{"tiles": [9999] * 16}, {"tiles": [-1] * 16}, {"labelled": [True]}, {"tiles": 1e999}]
)
def test_a_damaged_manifest_of_crops(copy, change):
    (path,) = copy.glob("crops-*/manifest.json")
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(CacheError, match="prepare` again"):
        Dataset(copy)


def test_counts_of_another_scheme(copy):
    path = copy / "dataset.json"
    values = json.loads(path.read_text())
    values["scans"][0]["tiles"][0]["class_counts"].append(0)
    path.write_text(json.dumps(values))
    with pytest.raises(CacheError, match="classes, the scheme has"):
        Dataset(copy)


@pytest.mark.parametrize("change", [{"labels": 99}, {"labels": -2}, {"is_core": False}])
def test_a_tile_the_manifest_does_not_know(copy, change):
    dataset = Dataset(copy)
    path = dataset.tiles[0].path
    tensors = load_file(path)
    for name, value in change.items():
        tensors[name][:] = value
    save_file(tensors, path)
    with pytest.raises(CacheError, match="voxels in its core"):
        dataset.tile(0)


def test_damaged_crops_and_tiles(copy):
    for path in (*copy.rglob("crop_00000.safetensors"), *copy.rglob("tile_0000.safetensors")):
        path.write_bytes(path.read_bytes()[:-20])
    dataset = Dataset(copy)
    with pytest.raises(CacheError, match="crop_00000"):
        dataset.cached_sample(0)
    with pytest.raises(CacheError, match="tile_0000"):
        dataset.tile(0)


@pytest.mark.parametrize(
    "change",
    [
        {"indices": np.zeros(512, np.float32)},
        {"indices": np.zeros((512, 1), np.int32)},
        {"indices": np.full(512, 10**6, np.int32)},
        {"indices": np.full(512, -1, np.int32)},
        {"indices": np.empty(0, np.int32)},
        {"indices": None},
        {"neighbors.1": None},
    ],
)
def test_a_crop_that_does_not_fit(copy, change):
    (path,) = copy.glob("crops-*/crop_00000.safetensors")
    tensors = load_file(path) | change
    save_file({name: t for name, t in tensors.items() if t is not None}, path)
    with pytest.raises(CacheError, match=r"crop 0 of .*run `bushseg prepare` again"):
        Dataset(copy).cached_sample(0)
