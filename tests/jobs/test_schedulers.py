"""Scans labelled by other processes: as this one would, and whatever becomes of them."""

import pytest

from bushseg import worker_pool
from bushseg.config import PredictConfig
from bushseg.errors import ConfigError, WorkerError
from bushseg.jobs import LABEL_TILE
from bushseg.prediction import predict_file
from bushseg.schedulers import opened
from bushseg.worker_pool import WorkerPool

SETTINGS = {"tile_points": 1000, "halo": 16}


def test_who_does_the_jobs():
    with opened() as scheduler:
        assert scheduler is None
    with opened(2) as scheduler:
        assert isinstance(scheduler, WorkerPool)


def test_workers_and_a_scheduler_exclude_each_other():
    with (
        pytest.raises(ConfigError, match="workers and scheduler are both set"),
        opened(2, "tcp://127.0.0.1:8786"),
    ):
        pass


def test_a_tile_that_kills_is_named_and_the_others_are_kept(
    model, scans, tmp_path, monkeypatch, deadly_workers
):
    alone = predict_file(scans / "south.las", tmp_path / "1.las", model, PredictConfig(**SETTINGS))
    deadly = deadly_workers(LABEL_TILE, "number", "1")
    config = PredictConfig(**SETTINGS, workers=2)
    path, output = model.path, tmp_path / "2.las"
    with pytest.raises(WorkerError) as caught:
        predict_file(scans / "south.las", output, path, config)
    said = str(caught.value)
    assert said.startswith("tile 1 (x ")
    assert "its worker was lost twice (SIGKILL" in said
    assert not output.exists()
    kept = sorted(tmp_path.glob(".2.las-*.bushseg/*/tile_*.safetensors"))
    numbers = [int(tile.stem.removeprefix("tile_")) for tile in kept]
    assert 1 not in numbers
    assert f"; {len(kept)} of {len(kept) + 1} tiles are done and kept" in said
    deadly.unlink()
    done = []
    monkeypatch.setattr(
        worker_pool,
        "_ask",
        lambda *ask, _do=worker_pool._ask: (
            done.append(ask[2]["number"]),
            _do(*ask),
        )[1],
    )
    result = predict_file(scans / "south.las", output, path, config)
    assert done == [1]
    assert output.read_bytes() == (tmp_path / "1.las").read_bytes()
    assert (result.passes, result.warnings) == (alone.passes, alone.warnings)
    assert not list(tmp_path.glob(".2.las-*"))
