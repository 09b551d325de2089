"""Prepare on top of what it wrote before: what it redoes, what it leaves, what it removes."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bushseg import preparation
from bushseg.config import PrepareConfig
from bushseg.preparation import prepare
from bushseg.prepared import DATASET


def snapshot(folder: Path) -> dict[str, tuple[int, int]]:
    """Inode and time of every file but the one that names what there is."""
    return {
        str(path.relative_to(folder)): (path.stat().st_ino, path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != DATASET
    }


def under(start: str, files: dict[str, tuple[int, int]]) -> set[tuple[str, tuple[int, int]]]:
    return {(path, state) for path, state in files.items() if path.startswith(start)}


def test_a_second_run_does_nothing(tmp_path: Path, site: Path, prepare_in: Callable) -> None:
    first = prepare_in(tmp_path, site)
    before = snapshot(first.folder)
    second = prepare_in(tmp_path, site)
    assert snapshot(first.folder) == before
    assert (second.num_redone, second.crops_redone) == (0, False)
    assert second.class_counts == first.class_counts
    assert second.num_crops == first.num_crops


def test_a_changed_setting_redoes_all_it_touches(
    tmp_path: Path, site: Path, prepare_in: Callable
) -> None:
    before = snapshot(prepare_in(tmp_path, site).folder)
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
        result = prepare_in(tmp_path, site, **{name: value})
        after = snapshot(result.folder)
        assert (result.num_redone, result.crops_redone) == (2, True), name
        assert not before.keys() & after.keys(), name
        before = after


@pytest.mark.parametrize(("name", "value"), [("crop_points", 300), ("num_crops", 4)])
def test_a_changed_crop_setting_redoes_the_crops_only(
    tmp_path: Path, site: Path, name: str, value: int, prepare_in: Callable
) -> None:
    before = snapshot(prepare_in(tmp_path, site).folder)
    result = prepare_in(tmp_path, site, **{name: value})
    after = snapshot(result.folder)
    assert (result.num_redone, result.crops_redone) == (0, True)
    assert before.items() & after.items() == under("scans/", before)


def test_a_changed_scan_is_redone_alone(tmp_path: Path, site: Path, prepare_in: Callable) -> None:
    before = snapshot(prepare_in(tmp_path, site).folder)
    os.utime(site / "lawn.ply", ns=(1, 1))
    result = prepare_in(tmp_path, site)
    after = snapshot(result.folder)
    assert (result.num_redone, result.crops_redone) == (1, True)
    assert before.items() & after.items() == under("scans/yard", before)


def test_changed_labels_beside_a_scan_redo_it(tmp_path: Path, prepare_in: Callable) -> None:
    xyz = np.random.default_rng(0).random((300, 3)) * [6, 6, 0]
    rows = np.column_stack([xyz, np.zeros((300, 4))])
    np.savetxt(tmp_path / "site.txt", rows, fmt="%.3f %.3f %.3f %d %d %d %d")
    labels = tmp_path / "site.labels"
    labels.write_text("2\n" * 300)
    assert prepare_in(tmp_path, tmp_path / "site.txt").class_counts["bush"] == 0
    labels.write_text("4\n" * 300)
    result = prepare_in(tmp_path, tmp_path / "site.txt")
    assert result.num_redone == 1
    assert result.class_counts["bush"] == result.num_voxels


def test_a_scan_taken_out_leaves_nothing_behind(
    tmp_path: Path, site: Path, prepare_in: Callable
) -> None:
    prepare_in(tmp_path, site)
    result = prepare_in(tmp_path, site / "yard.las")
    assert (result.num_scans, result.num_redone, result.crops_redone) == (1, 0, True)
    assert [path.name.split("-")[0] for path in (result.folder / "scans").iterdir()] == ["yard"]
    assert len(list(result.folder.glob("crops-*"))) == 1


def test_folders_that_are_not_ours_stay(
    tmp_path: Path, site: Path, save_ply: Callable, config: PrepareConfig
) -> None:
    """A data set made beside raw scans, in a folder called scans, must not cost the scans."""
    raw = tmp_path / "scans" / "2024-05"
    raw.mkdir(parents=True)
    notes = tmp_path / "crops-notes"
    notes.mkdir()
    scan = save_ply(raw / "lawn.ply", (2, 4))
    prepare([tmp_path / "scans"], tmp_path, config)
    prepare([scan, site / "yard.las"], tmp_path, config)
    assert scan.exists()
    assert notes.exists()


def test_an_interrupted_run_is_taken_up_again(
    tmp_path: Path, site: Path, prepare_in: Callable
) -> None:
    first = prepare_in(tmp_path, site)
    before = snapshot(first.folder)
    for manifest in first.folder.glob("*/lawn-*/manifest.json"):
        manifest.unlink()
    for manifest in first.folder.glob("crops-*/manifest.json"):
        manifest.unlink()
    second = prepare_in(tmp_path, site)
    assert (second.num_redone, second.crops_redone) == (1, True)
    assert snapshot(second.folder).keys() == before.keys()


@pytest.mark.parametrize("pattern", ["scans/lawn-*/tile_0001.*", "crops-*/crop_00003.*"])
def test_a_file_that_went_missing_is_made_again(
    tmp_path: Path, site: Path, pattern: str, prepare_in: Callable
) -> None:
    (path,) = prepare_in(tmp_path, site).folder.glob(pattern)
    path.unlink()
    result = prepare_in(tmp_path, site)
    assert path.exists()
    is_tile = pattern.startswith("scans")
    assert (result.num_redone, result.crops_redone) == (int(is_tile), not is_tile)


@pytest.mark.parametrize("content", ["", "{", '{"version": 0}'])
def test_damaged_manifests_are_made_again(
    tmp_path: Path, site: Path, content: str, prepare_in: Callable
) -> None:
    first = prepare_in(tmp_path, site)
    for manifest in first.folder.rglob("*.json"):
        manifest.write_text(content)
    second = prepare_in(tmp_path, site)
    assert (second.num_redone, second.crops_redone) == (2, True)
    assert second.class_counts == first.class_counts


def test_what_was_kept_to_go_on_with_goes_with_its_settings(
    tmp_path: Path, site: Path, monkeypatch: pytest.MonkeyPatch, prepare_in: Callable
) -> None:
    monkeypatch.setattr(preparation, "MAX_VOXELS", 200)
    monkeypatch.setattr(preparation, "write_crops", None)
    monkeypatch.setattr("bushseg.scan_tiles.save_tile", None)
    with pytest.raises(TypeError):
        prepare_in(tmp_path, site)
    (scratch,) = (tmp_path / "prepared").glob("scans/*/.scratch")
    with pytest.raises(TypeError):
        prepare_in(tmp_path, site)
    assert scratch.exists()
    with pytest.raises(TypeError):
        prepare_in(tmp_path, site, voxel_size=0.2)
    (other,) = (tmp_path / "prepared").glob("scans/*/.scratch")
    assert other != scratch
