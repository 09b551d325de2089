from dataclasses import replace

import numpy as np
import pytest

from bushseg import tiling
from bushseg.config import PredictConfig
from bushseg.errors import DataError
from bushseg.io import open_scan
from bushseg.labeler import check_features, cut, label_tiles
from bushseg.memory import HALO
from bushseg.scan import VoxelScan, read_voxels


@pytest.fixture(scope="module")
def scan(scans, model) -> VoxelScan:
    with open_scan(scans / "south.las") as reader:
        return read_voxels(reader, model.card.prepare.voxel_size)


def without(scan: VoxelScan, *names: str) -> VoxelScan:
    kept = {name: columns for name, columns in scan.features.items() if name not in names}
    return VoxelScan(scan.voxels, kept, None, scan.num_points, 0, {})


@pytest.mark.parametrize("tile_points", [1000, 100_000])
def test_cores_cover_every_voxel_once(model, scan, tile_points):
    tiles = list(label_tiles(model, scan, PredictConfig(tile_points=tile_points)))
    assert (len(tiles) == 1) == (tile_points == 100_000)
    indices = np.concatenate([tile.indices for tile in tiles])
    assert np.sort(indices).tolist() == list(range(len(scan.voxels)))
    for tile in tiles:
        assert tile.probabilities.shape == (len(tile.indices), 7)
        np.testing.assert_allclose(tile.probabilities.sum(axis=1), 1, rtol=1e-5)
        assert tile.num_seen >= len(tile.indices)


def test_within_memory_halos_count_towards_a_tile(model, scan, monkeypatch):
    monkeypatch.setattr(tiling, "_SMALL_CORE", 10)
    free, bounded = (
        cut(model, scan, PredictConfig(tile_points=1500, max_memory=limit))
        for limit in (None, 2_000_000_000)
    )
    assert max(map(free.size, free.tiles)) > HALO * 1500
    assert len(bounded.tiles) > len(free.tiles)
    for tile in bounded.tiles:
        # What can't be cut, since it is one block, stays as it is.
        edges = np.subtract(tile.high, tile.low)
        assert bounded.size(tile) <= HALO * 1500 or edges.tolist() == [1, 1]
    assert sum(tile.num_points for tile in bounded.tiles) == len(scan.voxels)


def test_one_tile_sees_each_voxel_once(model, scan):
    (tile,) = label_tiles(model, scan, PredictConfig())
    assert tile.num_seen == len(scan.voxels)


def test_the_halo_asked_for_is_the_one_used(model, scan):
    seen = [
        sum(t.num_seen for t in label_tiles(model, scan, PredictConfig(tile_points=1000, halo=h)))
        for h in (0, 16, 64)
    ]
    assert seen[0] == len(scan.voxels)
    assert seen[0] < seen[1] < seen[2]
    default = sum(t.num_seen for t in label_tiles(model, scan, PredictConfig(tile_points=1000)))
    assert default == seen[1]  # the model's data were prepared with 16


def test_a_missing_feature_that_is_optional(model, scan):
    bare = without(scan, "rgb", "intensity")
    check_features(model.card, bare)
    assert next(label_tiles(model, bare, PredictConfig())).num_seen == len(scan.voxels)


def test_a_missing_feature_that_is_needed(model, scan):
    with pytest.raises(DataError, match=r"needs rgb, intensity, height.*has rgb, intensity:"):
        next(label_tiles(model, without(scan, "height"), PredictConfig()))


def test_a_temperature_changes_how_sure_it_is_and_no_label(model, scan):
    warm = replace(model, card=model.card.model_copy(update={"temperature": 3.0}))
    cold = replace(model, card=model.card.model_copy(update={"temperature": 1.0}))
    (soft,), (hard,) = (list(label_tiles(it, scan, PredictConfig())) for it in (warm, cold))
    assert (soft.probabilities.argmax(axis=1) == hard.probabilities.argmax(axis=1)).all()
    assert soft.probabilities.max(axis=1).mean() < hard.probabilities.max(axis=1).mean() - 0.05
    cubed = hard.probabilities.astype(float) ** (1 / 3)
    cubed /= cubed.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(soft.probabilities, cubed, atol=1e-4)
