from pathlib import Path

import numpy as np
import pytest

from bushseg.grid import VoxelGrid
from bushseg.labeler import TilePrediction
from bushseg.stitch import Stitcher
from bushseg.subsample import GridSubsampler
from bushseg.tile_labels import TileLabels

XYZ = np.array([[0.0, 0, 0], [0.05, 0, 0], [5, 5, 5], [np.nan, 0, 0]])


def make_stitcher(bush_index: int | None, folder: Path | None = None) -> Stitcher:
    subsampler = GridSubsampler(VoxelGrid.around(XYZ[0], 1.0), None, folder, 1)
    subsampler.add(XYZ, {})
    voxels = subsampler.finish()
    assert len(voxels) == 2
    stitcher = Stitcher(voxels, bush_index)
    for point, row in ((0, [0.1, 0.7, 0.2]), (2, [0.5, 0.2, 0.3])):
        indices = voxels.find(voxels.grid.keys(XYZ[[point]]))
        tile = TilePrediction(indices, np.array([row], dtype=np.float32), 2, 0.1)
        stitcher.add(indices, TileLabels.of(tile, bush_index))
    assert stitcher.mean_confidence() == pytest.approx(0.6)
    return stitcher


@pytest.mark.parametrize("folder", [None, "scratch"])
def test_points_get_what_their_voxel_got(folder, tmp_path):
    found = make_stitcher(2, folder and tmp_path / folder).at(XYZ)
    assert found.labels.tolist() == [1, 1, 0, -1]
    np.testing.assert_allclose(found.confidence, [0.7, 0.7, 0.5, 0])
    np.testing.assert_allclose(found.bush_probability, [0.2, 0.2, 0.3, 0])
    assert found.labels.dtype == np.int16
    assert found.confidence.dtype == found.bush_probability.dtype == np.float32


def test_without_a_bush_class():
    assert make_stitcher(None).at(XYZ).bush_probability is None


def test_a_point_without_a_voxel():
    found = make_stitcher(2).at(np.array([[100.0, 0, 0], [np.inf, 0, 0]]))
    assert found.labels.tolist() == [-1, -1]
    assert found.confidence.tolist() == found.bush_probability.tolist() == [0, 0]
