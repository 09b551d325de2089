"""Prepare, end to end on tiny scans: what it writes, says and refuses."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bushseg import preparation, tile_making
from bushseg.cache import load_tensors, pyramid_from_tensors, read_json
from bushseg.config import PrepareConfig
from bushseg.dataset import Dataset
from bushseg.errors import ConfigError, DataError, ReadError, SchemeError
from bushseg.memory import fit_table
from bushseg.preparation import prepare
from bushseg.prepared import DATASET, crop_name, tile_name
from bushseg.tile_files import load_tile


def test_two_scans_become_tiles_and_crops(
    tmp_path: Path, site: Path, prepare_in: Callable, config: PrepareConfig
) -> None:
    result = prepare_in(tmp_path, site)
    assert (result.num_scans, result.num_redone, result.crops_redone) == (2, 2, True)
    assert (result.num_crops, result.num_points) == (5, 3_500)
    assert result.features == ("rgb", "intensity", "height")
    assert result.warnings == ()
    dataset = read_json(result.folder / DATASET)
    assert dataset["config"] == config.model_dump(mode="json")
    assert [Path(scan["path"]).name for scan in dataset["scans"]] == ["lawn.ply", "yard.las"]
    assert [scan["features"] for scan in dataset["scans"]] == [
        ["rgb", "height"],
        ["rgb", "intensity", "height"],
    ]
    counts = np.zeros(len(result.class_counts), dtype=int)
    tiles = []
    for scan in dataset["scans"]:
        folder = result.folder / scan["folder"]
        assert read_json(folder / "manifest.json")["tiles"] == scan["tiles"]
        raw_points = 0
        for number, entry in enumerate(scan["tiles"]):
            tile = load_tile(folder / tile_name(number))
            tiles.append(tile)
            assert entry["core_size"] == tile.is_core.sum()
            assert (tile.labels[~tile.is_core] == -1).all()
            assert (tile.labels[tile.is_core] >= 0).all()
            own = np.bincount(tile.labels[tile.is_core], minlength=len(counts))
            assert entry["class_counts"] == own.tolist()
            assert entry["neighbor_distance"] > 0
            counts += own
            raw_points += int(tile.counts[tile.is_core].sum())
        assert raw_points == scan["num_points"]
    assert len(tiles) == result.num_tiles > 2
    assert list(result.class_counts.values()) == dataset["class_counts"] == counts.tolist()
    assert result.num_voxels == counts.sum() == sum(tile.is_core.sum() for tile in tiles)
    present = {name for name, count in result.class_counts.items() if count}
    assert present == {"ground", "bush", "building"}
    crops = read_json(result.folder / dataset["crops"] / "manifest.json")
    assert len(crops["tiles"]) == crops["num_crops"] == 5
    for number, tile_number in enumerate(crops["tiles"]):
        tensors = load_tensors(result.folder / dataset["crops"] / crop_name(number))
        indices = tensors.pop("indices")
        assert len(indices) == min(256, len(tiles[tile_number]))
        assert (np.diff(indices) > 0).all()
        assert 0 <= indices[0] <= indices[-1] < len(tiles[tile_number])
        pyramid = pyramid_from_tensors(tensors, len(indices))
        assert pyramid.num_levels == 2


def test_by_default_crops_hold_every_voxel_twice(
    tmp_path: Path, site: Path, prepare_in: Callable
) -> None:
    result = prepare_in(tmp_path, site, num_crops=None)
    assert result.num_crops == -(-2 * result.num_voxels // 256)


def test_a_scan_given_twice_counts_once(
    tmp_path: Path, site: Path, monkeypatch: pytest.MonkeyPatch, prepare_in: Callable
) -> None:
    monkeypatch.chdir(site)
    result = prepare_in(
        tmp_path, site / "yard.las", Path("yard.las"), site / ".." / "site" / "yard.las"
    )
    assert (result.num_scans, result.num_points) == (1, 1_500)


def test_scans_of_one_name_do_not_collide(
    tmp_path: Path, site: Path, prepare_in: Callable, save_ply: Callable
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    save_ply(other / "lawn.ply", (2, 4), offset=3.0)
    result = prepare_in(tmp_path, site / "lawn.ply", other / "lawn.ply")
    assert len(list((result.folder / "scans").iterdir())) == 2


def test_scans_without_labels_or_colors_are_prepared_and_named(
    tmp_path: Path,
    site: Path,
    new_scene: Callable,
    write_las: Callable,
    prepare_in: Callable,
    save_ply: Callable,
) -> None:
    bare = save_ply(site / "bare.ply", None)
    plain = write_las(site / "plain.las", new_scene(1, 800), 1)
    result = prepare_in(tmp_path, site / "yard.las", bare, plain)
    assert result.features == ("rgb", "intensity", "height")  # what some lack the others teach
    assert Dataset(result.folder).partial_features == ("rgb", "intensity")
    assert len(result.warnings) == 1
    assert "1 of 3 scans have no labels" in result.warnings[0]
    assert "bare.ply" in result.warnings[0]
    alone = prepare_in(tmp_path, bare)
    assert sum(alone.class_counts.values()) == 0
    assert alone.num_crops == 5


def test_unknown_codes_are_counted_and_skipped_points_reported(
    tmp_path: Path, site: Path, prepare_in: Callable, save_ply: Callable
) -> None:
    odd = save_ply(site / "odd.ply", (2, 77))
    result = prepare_in(tmp_path, odd)
    assert len(result.warnings) == 1
    assert "500 points have codes" in result.warnings[0]
    assert "77 (500)" in result.warnings[0]
    assert result.class_counts["ground"] > 0
    assert result.class_counts["bush"] == 0
    none = save_ply(site / "none.ply", (1, 1))
    assert "nothing to train on" in " ".join(prepare_in(tmp_path, none).warnings)


def test_with_little_memory_the_same_files(
    tmp_path: Path,
    site: Path,
    monkeypatch: pytest.MonkeyPatch,
    prepare_in: Callable,
    config: PrepareConfig,
    contents: Callable,
) -> None:
    whole = contents(prepare_in(tmp_path / "whole", site).folder)
    told: list[int] = []
    honest = tile_making.write_tiles

    def watched(*args: Any) -> dict[str, Any]:
        told.append(args[4])
        return honest(*args[:4], 200, *args[5:])

    monkeypatch.setattr(tile_making, "write_tiles", watched)
    monkeypatch.setattr(preparation, "be_lean", lambda: told.append(-1))
    folder = prepare([site], tmp_path / "little", config, max_memory="600MB").folder
    assert told[0] == -1
    assert told[1] == told[2] == fit_table("600MB", config.tile_points, 7)
    assert contents(folder) == whole


def test_too_little_memory_is_refused_before_anything_is_done(
    tmp_path: Path, site: Path, config: PrepareConfig
) -> None:
    with pytest.raises(ConfigError, match=r"preparing tiles of 1,000 voxels takes at least 0\.5"):
        prepare([site], tmp_path / "prepared", config, max_memory=10**8)
    assert not (tmp_path / "prepared").exists()


def test_what_cannot_be_prepared_is_refused(
    tmp_path: Path, site: Path, prepare_in: Callable
) -> None:
    with pytest.raises(DataError, match="no scan found"):
        prepare_in(tmp_path)
    with pytest.raises(ReadError, match="no such file"):
        prepare_in(tmp_path, tmp_path / "nowhere.las")
    with pytest.raises(SchemeError):
        prepare_in(tmp_path, site, scheme="no such scheme")
    with pytest.raises(DataError, match="species"):
        prepare_in(tmp_path, site, label_field="species")


def test_equal_runs_give_equal_files(tmp_path: Path, site: Path, config: PrepareConfig) -> None:
    folders = [prepare([site], tmp_path / name, config).folder for name in ("a", "b")]
    files = [sorted(folder.rglob("*.safetensors")) for folder in folders]
    assert [path.name for path in files[0]] == [path.name for path in files[1]]
    for ours, theirs in zip(*files, strict=True):
        assert ours.read_bytes() == theirs.read_bytes()
