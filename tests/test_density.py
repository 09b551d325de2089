import numpy as np
import pytest

from bushseg import density
from bushseg.density import measure_density, sample_points
from bushseg.io.base import ScanInfo
from bushseg.io.kept import KeptReader
from bushseg.io.memory import MemoryReader
from bushseg.points import PointCloud


class Sliced(MemoryReader):
    """Hands out a hundred points at a time, states its bounds and counts readings."""

    readings = 0

    def __init__(self, xyz: np.ndarray) -> None:
        super().__init__(PointCloud(xyz))
        known = {name: getattr(self.info, name) for name in ScanInfo.__slots__}
        self.info = ScanInfo(**known | {"bounds": np.stack([xyz.min(axis=0), xyz.max(axis=0)])})

    def chunks(self, size=100):
        self.readings += 1
        return super().chunks(100)


def lattice(step: float, count: int) -> np.ndarray:
    x, y = np.meshgrid(np.arange(count) * step, np.arange(count) * step)
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(count**2)])


def test_a_lattice_by_hand():
    """Of nine neighbors in a square lattice, oneself included, the last is a diagonal away."""
    found = measure_density(lattice(1.0, 50), 0.2, 9)
    assert found.median == found.near == pytest.approx(2**0.5)
    assert found.spread == pytest.approx(1)


def test_it_is_what_a_tile_measures(prepared, scans):
    from bushseg.dataset import Dataset
    from bushseg.io import read

    dataset = Dataset(prepared)
    tiles = [tile.neighbor_distance for tile in dataset.tiles if tile.scan == 2]
    found = measure_density(read(scans / "south.las").xyz, 0.15, 8)
    assert min(tiles) * 0.95 < found.median < max(tiles) * 1.05


def test_few_points_are_enough():
    found = measure_density(np.zeros((1, 3)), 0.1, 16)
    assert (found.median, found.spread) == (0, np.inf)


def test_the_first_points_are_the_sample_and_read_once(monkeypatch):
    monkeypatch.setattr(density, "HEAD_POINTS", 300)
    reader = Sliced(lattice(1.0, 40))
    kept = KeptReader(reader)
    np.testing.assert_array_equal(sample_points(kept), reader.read().xyz[:300])
    assert sum(map(len, kept.chunks())) == 1600
    assert reader.readings == 1


def test_of_an_overview_some_patches_are_taken_whole(monkeypatch):
    """As COPC has it: the first points lie all over the scan, thinly."""
    monkeypatch.setattr(density, "HEAD_POINTS", 4000)
    xyz = np.random.default_rng(0).permutation(lattice(0.5, 300))
    kept = KeptReader(Sliced(xyz))
    found = measure_density(sample_points(kept), 0.2, 9)
    assert found.median == pytest.approx(0.5 * 2**0.5)
    thin = measure_density(xyz[:4000], 0.2, 9)
    assert thin.median > 2 * found.median


def test_no_returns_are_no_points():
    xyz = np.vstack([lattice(1.0, 10) + 1, np.zeros((50, 3)), np.full((3, 3), np.nan)])
    kept = KeptReader(MemoryReader(PointCloud(xyz), sensor=(0, 0, 0)))
    assert len(sample_points(kept)) == 100
