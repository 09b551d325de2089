"""A tile labelled from files to a file."""

import json

import numpy as np
import pytest

from bushseg import parallel
from bushseg.bundled import file_hash
from bushseg.checkpoint import save_model
from bushseg.config import PredictConfig
from bushseg.errors import CacheError, CheckpointError
from bushseg.io import open_scan
from bushseg.jobs import LABEL_TILE, run_job
from bushseg.labeler import cut, label_tile
from bushseg.scan import read_voxels
from bushseg.stages import Stages
from bushseg.stored_scan import store_scan
from bushseg.tile_jobs import forget, label_tile_job
from bushseg.tile_labels import TileLabels, tile_path

CONFIG = PredictConfig(tile_points=1000, halo=16)


@pytest.fixture
def stored(model, scans, tmp_path):
    """A scan in memory and cut, and the arguments of jobs for the same one stored."""
    folder = tmp_path / "scan"
    with open_scan(scans / "south.las") as reader:
        voxel_size = model.card.prepare.voxel_size
        scan = read_voxels(reader, voxel_size)
        apart = read_voxels(reader, voxel_size, folder=folder, on_disk=True)
    store_scan(apart, cut(model, apart, CONFIG))
    path = tmp_path / "model.safetensors"
    save_model(path, model.card, model.network)
    arguments = {
        "folder": str(folder),
        "model_path": str(path),
        "model_hash": file_hash(path),
        "settings": {"precision": "auto"},
    }
    yield scan, cut(model, scan, CONFIG), arguments
    forget()


def labels_of(model, folder, tile, number):
    scheme = model.card.scheme
    return TileLabels.load(
        tile_path(folder, number), tile.num_points, scheme.num_classes, has_bush=True
    )


@pytest.mark.parametrize("cores", [1, 3])
def test_a_job_says_what_the_process_itself_would(cores, model, stored, tmp_path, monkeypatch):
    scan, tiling, arguments = stored
    assert len(tiling.tiles) > 1
    expected = [
        TileLabels.of(label_tile(model, scan, tiling, tile, CONFIG, Stages()), 2)
        for tile in tiling.tiles
    ]
    monkeypatch.setattr(parallel, "num_workers", lambda: cores)
    monkeypatch.setattr("bushseg.decimation.num_workers", lambda: cores)
    for number, tile in enumerate(tiling.tiles):
        assert run_job(LABEL_TILE, json.loads(json.dumps(arguments | {"number": number}))) is None
        labels = labels_of(model, tmp_path / "scan", tile, number)
        np.testing.assert_array_equal(labels.labels, expected[number].labels)
        np.testing.assert_array_equal(labels.confidence, expected[number].confidence)
        np.testing.assert_array_equal(labels.bush, expected[number].bush)
        assert labels.num_seen == expected[number].num_seen
        assert labels.neighbor_distance == expected[number].neighbor_distance


def test_a_model_that_was_changed_is_refused(stored):
    *_, arguments = stored
    with pytest.raises(CheckpointError, match=r"the job means 0000"):
        label_tile_job(**(arguments | {"number": 0, "model_hash": 64 * "0"}))


def test_a_missing_model_is_refused(stored):
    *_, arguments = stored
    with pytest.raises(CheckpointError, match="can't be read"):
        label_tile_job(**(arguments | {"number": 0, "model_path": "/no/such/model"}))


@pytest.mark.parametrize("number", [-1, 1000])
def test_a_tile_that_is_not_there_is_refused(number, stored):
    *_, arguments = stored
    with pytest.raises(CacheError, match=f"none of number {number}"):
        label_tile_job(**(arguments | {"number": number}))


def test_a_refusal_comes_back_as_text(stored):
    *_, arguments = stored
    said = run_job(LABEL_TILE, arguments | {"number": 0, "folder": "/no/such/folder"})
    assert said is not None
    assert said.startswith("/no/such/folder/scan.json: can't be read (No such file")
