"""Labels of a tile, and the file they are kept in."""

import numpy as np
import pytest

from bushseg.errors import CacheError
from bushseg.labeler import TilePrediction
from bushseg.tile_labels import TileLabels

ROWS = np.array([[0.2, 0.6, 0.2], [0.4, 0.4, 0.2], [0.0, 0.1, 0.9]], dtype=np.float32)


def tile(bush_index: int | None = 2) -> TileLabels:
    return TileLabels.of(TilePrediction(np.arange(3), ROWS, 7, 0.25), bush_index)


def test_the_likeliest_class_wins_and_of_equal_ones_the_first() -> None:
    labels = tile()
    assert labels.labels.tolist() == [1, 0, 2]
    np.testing.assert_allclose(labels.confidence, [0.6, 0.4, 0.9])
    assert labels.bush is not None
    np.testing.assert_allclose(labels.bush, [0.2, 0.2, 0.9])
    assert tile(None).bush is None


@pytest.mark.parametrize("bush_index", [None, 2])
def test_what_is_kept_is_found_again(bush_index, tmp_path) -> None:
    path = tmp_path / "tile.safetensors"
    tile(bush_index).save(path)
    again = TileLabels.load(path, 3, 3, has_bush=bush_index is not None)
    assert again.labels.tolist() == [1, 0, 2]
    assert again.confidence.tolist() == tile().confidence.tolist()
    assert (again.bush is None) == (bush_index is None)
    assert (again.num_seen, again.neighbor_distance) == (7, 0.25)


@pytest.mark.parametrize(
    ("num_voxels", "num_classes", "has_bush", "message"),
    [
        (4, 3, True, "labels aren't those of this tile"),
        (3, 2, True, "a class that the model doesn't have"),
        (3, 3, True, "bush aren't"),
    ],
)
def test_another_tile_or_model_is_refused(
    num_voxels, num_classes, has_bush, message, tmp_path
) -> None:
    path = tmp_path / "tile.safetensors"
    tile(None if message.startswith("bush") else 2).save(path)
    with pytest.raises(CacheError, match=message):
        TileLabels.load(path, num_voxels, num_classes, has_bush=has_bush)


def test_a_damaged_file_is_refused(tmp_path) -> None:
    path = tmp_path / "tile.safetensors"
    tile().save(path)
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(CacheError, match="can't be read"):
        TileLabels.load(path, 3, 3, has_bush=True)
