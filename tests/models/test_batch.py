import numpy as np
import pytest
import torch

from bushseg.models.batch import Batch
from bushseg.pyramid import Pyramid


def test_from_numpy_scales_each_level_by_its_spacing():
    xyz = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype=np.float32)
    pyramid = Pyramid(
        neighbors=(np.array([[0], [1], [2], [3]], np.int32), np.array([[0], [1]], np.int32)),
        decimated=(np.array([1, 3], np.int32), np.array([1], np.int32)),
        interpolated=(np.array([0, 0, 0, 1], np.int32), np.array([0, 0], np.int32)),
    )
    batch = Batch.from_numpy(np.zeros((4, 2), np.float32), xyz, xyz + 1, pyramid, 0.5)
    first, second = batch.levels
    np.testing.assert_array_equal(first.xyz, xyz / 0.5)
    np.testing.assert_array_equal(second.xyz, xyz[[1, 3]] / 1.0)
    np.testing.assert_array_equal(second.normals, xyz[[1, 3]] + 1)
    assert first.neighbors.dtype == first.decimated.dtype == first.interpolated.dtype == torch.int32
    assert second.decimated.tolist() == [1]


def test_concatenated_shifts_indices(batch_of):
    sizes = (30, 1, 17)
    parts = [batch_of(size, seed) for seed, size in enumerate(sizes)]
    whole = Batch.concatenated(parts)
    assert len(whole.features) == sum(sizes)
    for depth, level in enumerate(whole.levels):
        start = below = 0
        for part in (part.levels[depth] for part in parts):
            rows = slice(start, start + len(part.xyz))
            survivors = slice(below, below + len(part.decimated))
            torch.testing.assert_close(level.xyz[rows], part.xyz)
            assert torch.equal(level.neighbors[rows] - start, part.neighbors)
            assert torch.equal(level.decimated[survivors] - start, part.decimated)
            assert torch.equal(level.interpolated[rows] - below, part.interpolated)
            start, below = rows.stop, survivors.stop
        assert start == len(level.xyz)


@pytest.mark.parametrize("size", [1, 30])
def test_one_batch_concatenated_is_itself(batch_of, size):
    batch = batch_of(size)
    again = Batch.concatenated([batch])
    assert torch.equal(again.features, batch.features)
    assert torch.equal(again.levels[1].neighbors, batch.levels[1].neighbors)


def test_to_keeps_everything(batch_of):
    batch = batch_of(20)
    moved = batch.to(torch.device("meta"))
    assert moved.features.device.type == "meta"
    for level, other in zip(moved.levels, batch.levels, strict=True):
        for name in ("xyz", "normals", "neighbors", "decimated", "interpolated"):
            tensor = getattr(level, name)
            assert tensor.device.type == "meta"
            assert tensor.shape == getattr(other, name).shape
