"""Processes that train together come to the weights that one comes to, also if one of them dies."""

import signal
import sys
import time
from pathlib import Path

import pytest
import torch

from bushseg.batches import EpochBatches
from bushseg.checkpoint import load_checkpoint
from bushseg.dataset import Dataset
from bushseg.ranks import Ranks
from bushseg.runs import LAST
from bushseg.training import train

TOLERANCE = 1e-4
"""Of weights of about 1, after six steps at a learning rate of 0.01.

Sums were taken in another order, and Adam makes much of small differences between small gradients.
That gradients are the same is held to 1e-9 in double precision, in `models/test_shared_norm.py`.
"""


def tensors(run: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(run / LAST)[2]


def command(prepared: Path, *options: object) -> list[object]:
    return [sys.executable, "-m", "bushseg_cli", "train", prepared, *options]


@pytest.mark.parametrize("fresh", [False, True])
@pytest.mark.parametrize("size", [2, 5])
def test_the_shares_of_a_batch_are_the_batch(prepared, tiny, monkeypatch, fresh, size):
    """With more processes than crops in the last batch, whose shares then are empty."""
    dataset = Dataset(prepared)
    config = tiny(batch_size=7, steps_per_epoch=3, fresh_crops=fresh).train
    whole = EpochBatches(dataset, range(len(dataset.tiles)), dataset.features, config, 0)
    shares = []
    for rank in range(size):
        ranks = Ranks(rank, size, torch.device("cpu"))
        monkeypatch.setattr("bushseg.batches.current", lambda ranks=ranks: ranks)
        shares.append(list(whole.start(1)))
    monkeypatch.undo()
    for (batch, labels), *parts in zip(whole.start(1), *shares, strict=True):
        assert torch.equal(torch.cat([part.features for part, _ in parts]), batch.features)
        assert torch.equal(
            torch.cat([part.levels[0].xyz for part, _ in parts]), batch.levels[0].xyz
        )
        assert torch.equal(torch.cat([known for _, known in parts]), labels)
        assert {part.features.shape[1] for part, _ in parts} == {batch.features.shape[1]}


def test_two_processes_come_to_the_weights_of_one(prepared, tiny, tmp_path, start_ranks):
    """Batches of five crops are shared out unevenly, the last one's to a single process."""
    config = tiny(epochs=2, steps_per_epoch=None, batch_size=5, validation="scan:south")
    (tmp_path / "tiny.toml").write_text(config.to_toml())
    both = start_ranks(
        command(prepared, "-o", tmp_path / "two", "-c", tmp_path / "tiny.toml", "--json"), 2
    )
    alone = train(prepared, tmp_path / "one", config)
    said = [process.communicate(timeout=240) for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    assert said[1] == ("", "")  # the first alone reports

    one, two = tensors(tmp_path / "one"), tensors(tmp_path / "two")
    assert one.keys() == two.keys()
    worst = max(float((one[n] - two[n]).abs().max()) for n in one if n.startswith("network."))
    assert 0 < worst < TOLERANCE
    history = load_checkpoint(tmp_path / "two" / LAST)[1]["history"]
    for mine, theirs in zip(alone.history, history, strict=True):
        del mine["points_per_second"], theirs["points_per_second"]
        assert theirs == pytest.approx(mine, abs=0.005, nan_ok=True)
        assert theirs["loss"] == pytest.approx(mine["loss"], abs=1e-4)
    names = ["best.safetensors", "config.toml", "curves.png", "last.safetensors", "metrics.csv"]
    assert sorted(path.name for path in (tmp_path / "two").iterdir()) == names


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("dead", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_a_process_dies_and_the_run_goes_on_from_its_checkpoint(
    prepared, tiny, tmp_path, start_ranks, dead
):
    config = tiny(epochs=40, steps_per_epoch=4, checkpoint_minutes=0, rank_timeout=60)
    (tmp_path / "tiny.toml").write_text(config.to_toml())
    folder = tmp_path / "killed"
    started = start_ranks(command(prepared, "-o", folder, "-c", tmp_path / "tiny.toml", "-q"), 2)
    while not (folder / LAST).exists() and all(p.poll() is None for p in started):
        time.sleep(0.05)
    started[dead].send_signal(signal.SIGKILL)
    _, err = started[1 - dead].communicate(timeout=60)
    assert started[1 - dead].returncode == 1
    assert err.count("\n") == 1
    assert f"process {1 - dead} of 2: another process of this training has ended" in err

    epochs = load_checkpoint(folder / LAST)[1]["epoch"] + 1
    resumed = start_ranks(command(prepared, "--resume", folder, "--epochs", epochs, "-q"), 2)
    options = ["-o", tmp_path / "whole", "-c", tmp_path / "tiny.toml", "--epochs", epochs, "-q"]
    whole = start_ranks(command(prepared, *options), 2)
    for process in (*resumed, *whole):
        assert process.wait(timeout=240) == 0, process.communicate()
    one, two = tensors(folder), tensors(tmp_path / "whole")
    assert all(torch.equal(one[name], two[name]) for name in one)
