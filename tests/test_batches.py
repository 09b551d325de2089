import numpy as np
import pytest
import torch

from bushseg.batches import EpochBatches
from bushseg.dataset import Dataset


@pytest.fixture(scope="module")
def dataset(prepared) -> Dataset:
    return Dataset(prepared)


@pytest.fixture
def epoch(dataset, tiny):
    """An epoch's batches: `epoch(tiles, number, **train settings)`."""

    def make(tiles=None, number=0, **settings) -> EpochBatches:
        config = tiny(**({"steps_per_epoch": None, "batch_size": 3} | settings)).train
        chosen = range(len(dataset.tiles)) if tiles is None else tiles
        return EpochBatches(dataset, chosen, dataset.features, config, number)

    return make


def same(one, two) -> bool:
    return all(
        torch.equal(a.features, b.features)
        and torch.equal(a.levels[0].xyz, b.levels[0].xyz)
        and torch.equal(labels, other)
        for (a, labels), (b, other) in zip(one, two, strict=True)
    )


def test_one_pass_shows_every_crop_once(epoch, dataset):
    batches = epoch()
    found = list(batches.start())
    assert len(found) == len(batches) == -(-16 // 3)
    assert batches.num_crops == 16
    assert sum(len(labels) for _, labels in found) == 16 * 512
    shown = np.sort(np.concatenate([labels.numpy() for _, labels in found]))
    cached = [dataset.cached_sample(number).labels for number in range(16)]
    np.testing.assert_array_equal(shown, np.sort(np.concatenate(cached)))


def test_batches_have_a_feature_row_and_a_label_for_each_point(epoch):
    for batch, labels in epoch().start():
        assert batch.features.shape == (len(labels), 5)
        assert len(batch.levels[0].xyz) == len(labels)
        assert len(batch.levels) == 2


@pytest.mark.parametrize("fresh", [False, True])
def test_a_later_start_gives_the_same_batches(epoch, fresh):
    whole = list(epoch(fresh_crops=fresh, steps_per_epoch=5).start())
    assert len(whole) == 5
    assert same(whole, epoch(fresh_crops=fresh, steps_per_epoch=5).start())
    assert same(whole[3:], epoch(fresh_crops=fresh, steps_per_epoch=5).start(3))
    assert list(epoch(fresh_crops=fresh, steps_per_epoch=5).start(5)) == []


@pytest.mark.parametrize("fresh", [False, True])
def test_epochs_and_seeds_differ(epoch, fresh):
    settings = {"fresh_crops": fresh, "steps_per_epoch": 1, "batch_size": 1}
    features = [
        next(iter(epoch(number=number, seed=seed, **settings).start()))[0].features
        for number, seed in ((0, 0), (1, 0), (0, 1))
    ]
    assert not torch.equal(features[0], features[1])
    assert not torch.equal(features[0], features[2])


@pytest.mark.parametrize("fresh", [False, True])
def test_only_the_tiles_asked_for(epoch, dataset, fresh):
    tiles = [0, 2]
    known = {row.tobytes() for tile in tiles for row in dataset.tile(tile).features["rgb"]}
    augmentation = {"rotate": False, "scale": 0, "jitter": 0, "color_jitter": 0}
    batches = epoch(tiles, fresh_crops=fresh, augment={**augmentation, "feature_dropout": 0})
    assert len(batches) > 0
    for batch, _ in batches.start():
        assert {row.tobytes() for row in batch.features[:, :3].contiguous().numpy()} <= known


def test_what_goes_wrong_in_the_background_is_raised(epoch, dataset, monkeypatch):
    def fail(number):
        raise OSError("disk gone")

    monkeypatch.setattr(dataset, "cached_sample", fail)
    with pytest.raises(OSError, match="disk gone"):
        list(epoch().start())
