import numpy as np
import pytest
import torch

from bushseg.dataset import Dataset
from bushseg.inference import feature_matrix, probabilities, tile_logits


def test_features_stand_in_the_network_s_order_and_what_is_missing_is_zero():
    features = {
        "height": np.full((2, 1), 3, np.float32),
        "rgb": np.array([[1, 2, 3], [4, 5, 6]], np.float32),
    }
    found = feature_matrix(features, ("rgb", "intensity", "height"), 2)
    assert found.tolist() == [[1, 2, 3, 0, 3], [4, 5, 6, 0, 3]]
    assert found.dtype == np.float32


def test_features_the_network_does_not_take_are_left_out():
    features = {name: np.ones((2, 1), np.float32) for name in ("intensity", "height")}
    assert feature_matrix(features, ("height",), 2).shape == (2, 1)


def test_probabilities_by_hand():
    found = probabilities(np.log(np.array([[1, 3], [2, 2]], dtype=np.float32)))
    np.testing.assert_allclose(found, [[0.25, 0.75], [0.5, 0.5]], rtol=1e-6)
    assert probabilities(np.array([[1000, -1000]], np.float32)).tolist() == [[1, 0]]


def test_a_tile_gives_its_core(model, prepared):
    dataset = Dataset(prepared)
    tile = dataset.network_tile(0)
    assert 0 < tile.is_core.sum() < len(tile)
    logits = tile_logits(model.network, tile, model.card.features, dataset.config.voxel_size)
    assert logits.shape == (tile.is_core.sum(), 7)
    assert logits.dtype == np.float32
    correct = logits.argmax(axis=1) == tile.labels[tile.is_core]
    assert correct.mean() == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        ("DefaultCPUAllocator: can't allocate memory: you tried", MemoryError),
        ("CUDA out of memory. Tried", MemoryError),
        ("shapes don't match", RuntimeError),
    ],
)
def test_memory_that_torch_lacks_is_python_s_error(message, kind, model, prepared):
    def refuse(_: object) -> None:
        raise RuntimeError(message)

    class Refusing(torch.nn.Linear):
        forward = staticmethod(refuse)

    tile = Dataset(prepared).network_tile(0)
    with pytest.raises(kind):
        tile_logits(Refusing(1, 1), tile, model.card.features, 0.15)
