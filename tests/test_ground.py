"""Height above ground on made-up terrain whose every height is known."""

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from bushseg import ground
from bushseg.ground import CELL, height_above_ground
from bushseg.ground_filter import WINDOW, filter_ground
from bushseg.scratch import Scratch


def terrain(seed: int, slope: float = 0.0, count: int = 20_000, edge: float = 60.0) -> np.ndarray:
    """Points of a plane that rises in x, (count, 3)."""
    xy = np.random.default_rng(seed).random((count, 2)) * edge
    return np.column_stack([xy, slope * xy[:, 0]])


def blob(
    seed: int, middle: tuple[float, float], low: float, high: float, radius: float
) -> np.ndarray:
    """An upright cylinder of leaves, (500, 3)."""
    rng = np.random.default_rng(seed)
    offsets = rng.uniform(-1, 1, (500, 2)) * radius
    return np.column_stack([offsets + middle, rng.uniform(low, high, 500)])


def test_flat_ground_is_at_zero() -> None:
    np.testing.assert_allclose(height_above_ground(terrain(0) + 100), 0, atol=1e-5)


def test_a_single_point_lies_on_its_ground() -> None:
    assert height_above_ground(np.array([[3.0, 4.0, 5.0]])).tolist() == [0]
    assert height_above_ground(np.empty((0, 3))).shape == (0,)


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_plants_on_a_slope_stand_at_their_true_heights(slope: float) -> None:
    plants = np.concatenate([blob(1, (20, 20), 0, 1.5, 1.5), blob(2, (42, 35), 4, 12, 4)])
    true = np.concatenate([np.zeros(20_000), plants[:, 2]])
    plants[:, 2] += slope * plants[:, 0]
    scan = np.concatenate([terrain(0, slope), plants])
    error = height_above_ground(scan) - true
    # A cell takes its lowest point, so a slope lowers the ground by up to a cell's rise.
    low, high = -0.05 - CELL * slope, 0.05 + 1.5 * CELL * slope
    assert ((error > low) & (error < high))[scan[:, 0] < 60 - WINDOW / 2].all()
    # At the upper border the opening cuts the hill off, half a window wide: a known limit.
    assert ((error > low) & (error < high + WINDOW / 2 * slope)).all()


def test_a_stray_pit_does_not_pull_the_ground_down() -> None:
    pit = np.array([[30.0, 30.0, -25.0]])
    height = height_above_ground(np.concatenate([terrain(0), pit]))
    np.testing.assert_allclose(height[:-1], 0, atol=0.01)
    assert height[-1] == pytest.approx(-25, abs=0.01)


def test_few_ground_hits_below_a_dense_stand_are_believed() -> None:
    rng = np.random.default_rng(3)
    canopy = np.column_stack([rng.random((20_000, 2)) * 60, rng.uniform(8, 15, 20_000)])
    hits = np.column_stack([rng.random((60, 2)) * 60, np.zeros(60)])
    height = height_above_ground(np.concatenate([canopy, hits]))
    np.testing.assert_allclose(height[-60:], 0, atol=0.5)
    assert (np.abs(height[:-60] - canopy[:, 2]) < 0.5).mean() > 0.99


@pytest.mark.parametrize("shift", [(0, 0, 350.5), (17.0, -33.0, 0), (4096.0, 128.0, -8.0)])
def test_moving_the_scan_leaves_its_heights(shift: tuple[float, float, float]) -> None:
    scan = np.concatenate([terrain(4, 0.2), blob(5, (20, 30), 4, 8, 1)])
    scan = np.round(scan * 1024) / 1024  # exact after any of the shifts
    before, after = height_above_ground(scan), height_above_ground(scan + shift)
    np.testing.assert_allclose(after, before, atol=1e-5)


def test_a_point_far_away_costs_a_sheet() -> None:
    scan = np.concatenate([terrain(6), [[10_000.0, 10_000.0, 0.0]]])
    height = height_above_ground(scan)
    np.testing.assert_allclose(height, 0, atol=1e-5)
    found = ground.Ground.below(scan, Scratch())
    assert len(found.rasters) == 2
    assert found.cell == CELL


@pytest.mark.parametrize("extent", [1e5, 2e8, 1e12])
def test_the_raster_is_bounded_whatever_the_extent(extent: float) -> None:
    xyz = np.array([[0.0, 0, 1], [extent, 1, 1], [2, extent, 1]])
    found = ground.Ground.below(xyz, Scratch())
    assert np.isfinite(found.heights(xyz)).all()
    assert found.rasters.size < 2 * ground._MIN_CELLS
    assert found.rows.size <= ground._MAX_SHEETS


def test_a_raster_is_no_finer_than_its_points_need(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground, "_MIN_CELLS", 1)
    xyz = np.random.default_rng(0).random((500, 3)) * [400, 400, 1]
    found = ground.Ground.below(xyz, Scratch())
    assert found.cell == 8
    assert found.rasters.size < 2 * 8 * len(xyz)


@pytest.mark.parametrize("folder", [None, "scratch"])
def test_sheets_fit_together(
    folder: str | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scan = np.concatenate(
        [terrain(8, 0.1, 60_000, 200.0), blob(9, (90, 70), 3, 9, 6), blob(1, (128, 20), 0, 2, 1)]
    )
    whole = height_above_ground(scan)
    monkeypatch.setattr(ground, "SHEET", 64)
    for loop in (ground._mark, ground._lower, ground._rise):  # they hold it as a constant
        monkeypatch.setattr(ground, loop.__name__, loop.py_func)
    sheets = ground.Ground.below(scan, Scratch(folder and tmp_path / folder))
    assert sheets.rows.shape == (4, 4)
    np.testing.assert_allclose(sheets.heights(scan), whole, atol=1e-9)


@pytest.mark.parametrize(("count", "edge"), [(1, 1.0), (40, 5.0), (4_000, 30.0), (4_000, 0.5)])
def test_heights_are_those_of_an_interpolated_raster(count: int, edge: float) -> None:
    xyz = np.random.default_rng(7).random((count, 3)) * [edge, 2 * edge, 3] - [edge / 3, 0, 0]
    positions = xyz[:, :2] / CELL
    positions -= np.floor(positions.min(axis=0))
    lowest = np.full(positions.astype(int).max(axis=0) + 1, np.inf)
    np.minimum.at(lowest, tuple(positions.astype(int).T), xyz[:, 2])
    raster = filter_ground(lowest, CELL)
    plain = ndimage.map_coordinates(raster, (positions - 0.5).T, order=1, mode="nearest")
    np.testing.assert_allclose(height_above_ground(xyz), xyz[:, 2] - plain, atol=1e-6)
