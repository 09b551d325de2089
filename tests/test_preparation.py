"""Prepare, end to end on tiny scans: what it writes, and what a second run redoes."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from bushseg import preparation, tile_making
from bushseg.cache import load_tensors, pyramid_from_tensors, read_json
from bushseg.config import PrepareConfig
from bushseg.dataset import Dataset
from bushseg.errors import ConfigError, DataError, ReadError, SchemeError
from bushseg.memory import fit_table
from bushseg.preparation import PrepareResult, prepare
from bushseg.prepared import DATASET, crop_name, tile_name
from bushseg.tile_files import load_tile

CONFIG = PrepareConfig(
    voxel_size=0.1,
    num_neighbors=8,
    num_levels=2,
    tile_points=1_000,
    halo=16,
    crop_points=256,
    num_crops=5,
)


def save_ply(path: Path, codes: tuple[int, ...] | None, offset: float = 0.0) -> Path:
    """A lawn of 6 x 6 m with a blob on it; codes: what the lawn and the blob are."""
    rng = np.random.default_rng(len(path.stem))
    lawn = rng.random((1_500, 3)) * [6, 6, 0]
    blob = rng.normal(size=(500, 3)) * 0.4 + [3, 3, 1]
    xyz = np.concatenate([lawn, blob]) + offset
    columns = dict(zip("xyz", xyz.T, strict=True))
    columns |= {name: rng.integers(0, 256, 2_000, "u1") for name in ("red", "green", "blue")}
    if codes:
        columns["label"] = np.repeat(codes, [1_500, 500]).astype(np.int32)
    rows = np.rec.fromarrays(list(columns.values()), names=list(columns))
    PlyData([PlyElement.describe(rows, "vertex")]).write(str(path))
    return path


@pytest.fixture
def site(tmp_path: Path, new_scene: Callable, write_las: Callable) -> Path:
    """Two labelled scans: a PLY with colors, a LAS with colors and intensity."""
    folder = tmp_path / "site"
    folder.mkdir()
    save_ply(folder / "lawn.ply", (2, 4))
    write_las(folder / "yard.las", new_scene(0, 1_500))
    return folder


def run(folder: Path, *sources: Path, **changes: object) -> PrepareResult:
    return prepare(sources, folder / "prepared", CONFIG.model_copy(update=changes))


def snapshot(folder: Path) -> dict[str, tuple[int, int]]:
    """Inode and time of every file but the one that names what there is."""
    return {
        str(path.relative_to(folder)): (path.stat().st_ino, path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != DATASET
    }


def under(start: str, files: dict[str, tuple[int, int]]) -> set[tuple[str, tuple[int, int]]]:
    return {(path, state) for path, state in files.items() if path.startswith(start)}


def test_two_scans_become_tiles_and_crops(tmp_path: Path, site: Path) -> None:
    result = run(tmp_path, site)
    assert (result.num_scans, result.num_redone, result.crops_redone) == (2, 2, True)
    assert (result.num_crops, result.num_points) == (5, 3_500)
    assert result.features == ("rgb", "intensity", "height")
    assert result.warnings == ()
    dataset = read_json(result.folder / DATASET)
    assert dataset["config"] == CONFIG.model_dump(mode="json")
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


def test_by_default_crops_hold_every_voxel_twice(tmp_path: Path, site: Path) -> None:
    result = run(tmp_path, site, num_crops=None)
    assert result.num_crops == -(-2 * result.num_voxels // 256)


def test_a_second_run_does_nothing(tmp_path: Path, site: Path) -> None:
    first = run(tmp_path, site)
    before = snapshot(first.folder)
    second = run(tmp_path, site)
    assert snapshot(first.folder) == before
    assert (second.num_redone, second.crops_redone) == (0, False)
    assert second.class_counts == first.class_counts
    assert second.num_crops == first.num_crops


def test_a_changed_setting_redoes_all_it_touches(tmp_path: Path, site: Path) -> None:
    before = snapshot(run(tmp_path, site).folder)
    changes: dict[str, object] = {
        "voxel_size": 0.3,
        "halo": 32,
        "tile_points": 2_000,
        "num_neighbors": 9,
        "num_levels": 1,
        "decimation": 3,
        "sampling": "random",
        "seed": 1,
        "scheme": "asprs",
    }
    # Every setting there is, lest a new one be forgotten.
    others = {"label_field", "crop_points", "num_crops"}
    assert PrepareConfig.model_fields.keys() == changes.keys() | others
    for name, value in changes.items():
        result = run(tmp_path, site, **{name: value})
        after = snapshot(result.folder)
        assert (result.num_redone, result.crops_redone) == (2, True), name
        assert not before.keys() & after.keys(), name
        before = after


@pytest.mark.parametrize(("name", "value"), [("crop_points", 300), ("num_crops", 4)])
def test_a_changed_crop_setting_redoes_the_crops_only(
    tmp_path: Path, site: Path, name: str, value: int
) -> None:
    before = snapshot(run(tmp_path, site).folder)
    result = run(tmp_path, site, **{name: value})
    after = snapshot(result.folder)
    assert (result.num_redone, result.crops_redone) == (0, True)
    assert before.items() & after.items() == under("scans/", before)


def test_a_changed_scan_is_redone_alone(tmp_path: Path, site: Path) -> None:
    before = snapshot(run(tmp_path, site).folder)
    os.utime(site / "lawn.ply", ns=(1, 1))
    result = run(tmp_path, site)
    after = snapshot(result.folder)
    assert (result.num_redone, result.crops_redone) == (1, True)
    assert before.items() & after.items() == under("scans/yard", before)


def test_changed_labels_beside_a_scan_redo_it(tmp_path: Path) -> None:
    xyz = np.random.default_rng(0).random((300, 3)) * [6, 6, 0]
    rows = np.column_stack([xyz, np.zeros((300, 4))])
    np.savetxt(tmp_path / "site.txt", rows, fmt="%.3f %.3f %.3f %d %d %d %d")
    labels = tmp_path / "site.labels"
    labels.write_text("2\n" * 300)
    assert run(tmp_path, tmp_path / "site.txt").class_counts["bush"] == 0
    labels.write_text("4\n" * 300)
    result = run(tmp_path, tmp_path / "site.txt")
    assert result.num_redone == 1
    assert result.class_counts["bush"] == result.num_voxels


def test_a_scan_given_twice_counts_once(
    tmp_path: Path, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(site)
    result = run(tmp_path, site / "yard.las", Path("yard.las"), site / ".." / "site" / "yard.las")
    assert (result.num_scans, result.num_points) == (1, 1_500)


def test_a_scan_taken_out_leaves_nothing_behind(tmp_path: Path, site: Path) -> None:
    run(tmp_path, site)
    result = run(tmp_path, site / "yard.las")
    assert (result.num_scans, result.num_redone, result.crops_redone) == (1, 0, True)
    assert [path.name.split("-")[0] for path in (result.folder / "scans").iterdir()] == ["yard"]
    assert len(list(result.folder.glob("crops-*"))) == 1


def test_scans_of_one_name_do_not_collide(tmp_path: Path, site: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    save_ply(other / "lawn.ply", (2, 4), offset=3.0)
    result = run(tmp_path, site / "lawn.ply", other / "lawn.ply")
    assert len(list((result.folder / "scans").iterdir())) == 2


def test_folders_that_are_not_ours_stay(tmp_path: Path, site: Path) -> None:
    """A data set made beside raw scans, in a folder called scans, must not cost the scans."""
    raw = tmp_path / "scans" / "2024-05"
    raw.mkdir(parents=True)
    notes = tmp_path / "crops-notes"
    notes.mkdir()
    scan = save_ply(raw / "lawn.ply", (2, 4))
    prepare([tmp_path / "scans"], tmp_path, CONFIG)
    prepare([scan, site / "yard.las"], tmp_path, CONFIG)
    assert scan.exists()
    assert notes.exists()


def test_an_interrupted_run_is_taken_up_again(tmp_path: Path, site: Path) -> None:
    first = run(tmp_path, site)
    before = snapshot(first.folder)
    for manifest in first.folder.glob("*/lawn-*/manifest.json"):
        manifest.unlink()
    for manifest in first.folder.glob("crops-*/manifest.json"):
        manifest.unlink()
    second = run(tmp_path, site)
    assert (second.num_redone, second.crops_redone) == (1, True)
    assert snapshot(second.folder).keys() == before.keys()


@pytest.mark.parametrize("pattern", ["scans/lawn-*/tile_0001.*", "crops-*/crop_00003.*"])
def test_a_file_that_went_missing_is_made_again(tmp_path: Path, site: Path, pattern: str) -> None:
    (path,) = run(tmp_path, site).folder.glob(pattern)
    path.unlink()
    result = run(tmp_path, site)
    assert path.exists()
    is_tile = pattern.startswith("scans")
    assert (result.num_redone, result.crops_redone) == (int(is_tile), not is_tile)


@pytest.mark.parametrize("content", ["", "{", '{"version": 0}'])
def test_damaged_manifests_are_made_again(tmp_path: Path, site: Path, content: str) -> None:
    first = run(tmp_path, site)
    for manifest in first.folder.rglob("*.json"):
        manifest.write_text(content)
    second = run(tmp_path, site)
    assert (second.num_redone, second.crops_redone) == (2, True)
    assert second.class_counts == first.class_counts


def test_scans_without_labels_or_colors_are_prepared_and_named(
    tmp_path: Path, site: Path, new_scene: Callable, write_las: Callable
) -> None:
    bare = save_ply(site / "bare.ply", None)
    plain = write_las(site / "plain.las", new_scene(1, 800), 1)
    result = run(tmp_path, site / "yard.las", bare, plain)
    assert result.features == ("rgb", "intensity", "height")  # what some lack the others teach
    assert Dataset(result.folder).partial_features == ("rgb", "intensity")
    assert len(result.warnings) == 1
    assert "1 of 3 scans have no labels" in result.warnings[0]
    assert "bare.ply" in result.warnings[0]
    alone = run(tmp_path, bare)
    assert sum(alone.class_counts.values()) == 0
    assert alone.num_crops == 5


def test_unknown_codes_are_counted_and_skipped_points_reported(tmp_path: Path, site: Path) -> None:
    odd = save_ply(site / "odd.ply", (2, 77))
    result = run(tmp_path, odd)
    assert len(result.warnings) == 1
    assert "500 points have codes" in result.warnings[0]
    assert "77 (500)" in result.warnings[0]
    assert result.class_counts["ground"] > 0
    assert result.class_counts["bush"] == 0
    none = save_ply(site / "none.ply", (1, 1))
    assert "nothing to train on" in " ".join(run(tmp_path, none).warnings)


def test_with_little_memory_the_same_files(
    tmp_path: Path, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = snapshot(run(tmp_path / "whole", site).folder)
    told: list[int] = []
    honest = tile_making.write_tiles

    def watched(*args: Any) -> dict[str, Any]:
        told.append(args[4])
        return honest(*args[:4], 200, *args[5:])

    monkeypatch.setattr(tile_making, "write_tiles", watched)
    monkeypatch.setattr(preparation, "be_lean", lambda: told.append(-1))
    folder = prepare([site], tmp_path / "little", CONFIG, max_memory="600MB").folder
    assert told[0] == -1
    assert told[1] == told[2] == fit_table("600MB", CONFIG.tile_points, 7)
    for path in whole:
        assert (folder / path).read_bytes() == (tmp_path / "whole/prepared" / path).read_bytes()
    assert snapshot(folder).keys() == whole.keys()


def test_too_little_memory_is_refused_before_anything_is_done(tmp_path: Path, site: Path) -> None:
    with pytest.raises(ConfigError, match=r"preparing tiles of 1,000 voxels takes at least 0\.5"):
        prepare([site], tmp_path / "prepared", CONFIG, max_memory=10**8)
    assert not (tmp_path / "prepared").exists()


def test_what_was_kept_to_go_on_with_goes_with_its_settings(
    tmp_path: Path, site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preparation, "MAX_VOXELS", 200)
    monkeypatch.setattr(preparation, "write_crops", None)
    monkeypatch.setattr("bushseg.scan_tiles.save_tile", None)
    with pytest.raises(TypeError):
        run(tmp_path, site)
    (scratch,) = (tmp_path / "prepared").glob("scans/*/.scratch")
    with pytest.raises(TypeError):
        run(tmp_path, site)
    assert scratch.exists()
    with pytest.raises(TypeError):
        run(tmp_path, site, voxel_size=0.2)
    (other,) = (tmp_path / "prepared").glob("scans/*/.scratch")
    assert other != scratch


def test_what_cannot_be_prepared_is_refused(tmp_path: Path, site: Path) -> None:
    with pytest.raises(DataError, match="no scan found"):
        run(tmp_path)
    with pytest.raises(ReadError, match="no such file"):
        run(tmp_path, tmp_path / "nowhere.las")
    with pytest.raises(SchemeError):
        run(tmp_path, site, scheme="no such scheme")
    with pytest.raises(DataError, match="species"):
        run(tmp_path, site, label_field="species")


def test_equal_runs_give_equal_files(tmp_path: Path, site: Path) -> None:
    folders = [prepare([site], tmp_path / name, CONFIG).folder for name in ("a", "b")]
    files = [sorted(folder.rglob("*.safetensors")) for folder in folders]
    assert [path.name for path in files[0]] == [path.name for path in files[1]]
    for ours, theirs in zip(*files, strict=True):
        assert ours.read_bytes() == theirs.read_bytes()
