"""Training crops: drawn by MRS, cheaply, and covering a scene with few repeats."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from bushseg import crops
from bushseg.crops import CropSampler, class_weights, enough_crops
from bushseg.neighbors import NeighborIndex
from bushseg.sampling import _BLOCK

SIZE = 64


def tile(seed: int, count: int = 800, label: int = -1) -> SimpleNamespace:
    """A flat tile of 8 x 6 m whose last 2 m in x are halo."""
    xyz = (np.random.default_rng(seed).random((count, 3)) * [8, 6, 0.3]).astype(np.float32)
    is_core = xyz[:, 0] < 6
    labels = np.where(is_core, label, -1).astype(np.int16)
    return SimpleNamespace(xyz=xyz, is_core=is_core, labels=labels)


def sampler(
    tiles: list[SimpleNamespace], weights: np.ndarray | None = None, seed: int = 0
) -> CropSampler:
    return CropSampler(
        [int(each.is_core.sum()) for each in tiles],
        lambda number: tiles[number],
        SIZE,
        class_weights(np.zeros(1, np.int64)) if weights is None else weights,
        np.random.default_rng(seed),
    )


def test_weights_are_the_classes_shares_and_one_without_a_label() -> None:
    weights = class_weights(np.array([6, 0, 2]))
    assert weights.tolist() == [0.75, 0, 0.25, 1]
    assert weights[-1] == 1
    assert class_weights(np.zeros(2, np.int64)).tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    ("points", "crop", "crops_needed"), [(100, 50, 4), (101, 50, 5), (1, 256, 1)]
)
def test_enough_crops_hold_every_point_twice(points: int, crop: int, crops_needed: int) -> None:
    assert enough_crops(points, crop) == crops_needed


def test_a_draw_takes_the_smallest_zeta_and_raises_its_core_points_by_eq_3() -> None:
    tiles = [tile(0), tile(1)]
    crop_sampler = sampler(tiles)
    core = [np.flatnonzero(each.is_core) for each in tiles]
    owners = np.repeat([0, 1], [len(rows) for rows in core])
    for _ in range(20):
        before = crop_sampler.queue.zeta.copy()
        center = int(before.argmin())
        crop = crop_sampler.draw()
        assert crop.tile == owners[center]
        points = tiles[crop.tile]
        start = len(core[0]) * crop.tile
        middle = points.xyz[core[crop.tile][center - start]]
        distances = np.linalg.norm(points.xyz - middle, axis=1)
        nearest = np.argsort(distances)[:SIZE]
        np.testing.assert_array_equal(crop.indices, np.sort(nearest))
        raised = np.zeros(len(points.xyz))
        raised[nearest] = np.sqrt(1 - distances[nearest] / distances[nearest].max())
        expected = before.copy()
        expected[start : start + len(core[crop.tile])] += raised[core[crop.tile]]
        np.testing.assert_allclose(crop_sampler.queue.zeta, expected, atol=1e-6)


def test_halo_points_are_drawn_but_carry_no_zeta() -> None:
    lone = tile(2)
    crop_sampler = sampler([lone])
    assert crop_sampler.queue.num_points == lone.is_core.sum() < len(lone.xyz)
    drawn = np.concatenate([crop.indices for crop in crop_sampler.draws(40)])
    assert not lone.is_core[drawn].all()


def test_a_tile_smaller_than_a_crop_gives_all_it_has() -> None:
    small = tile(3, 20)
    assert sampler([small]).draw().indices.tolist() == list(range(20))


def test_tiles_without_core_points_are_never_drawn() -> None:
    empty = tile(4)
    empty.is_core[:] = False
    tiles = [empty, tile(5), empty, empty, tile(6), empty]
    assert {crop.tile for crop in sampler(tiles).draws(60)} == {1, 4}


def test_rare_classes_return_sooner() -> None:
    tiles = [tile(7, label=0), tile(8, label=1)]
    weights = class_weights(np.array([9, 1]))
    drawn = [crop.tile for crop in sampler(tiles, weights).draws(400)]
    even = [crop.tile for crop in sampler(tiles).draws(400)]
    assert np.mean(drawn) > 0.7
    assert np.mean(even) == pytest.approx(0.5, abs=0.05)


def test_a_draw_looks_at_the_blocks_of_its_points_only() -> None:
    """Zeta is poisoned wherever a draw has no business, and nothing changes."""
    tiles = [tile(seed) for seed in range(12)]
    crop_sampler, twin = sampler(tiles), sampler(tiles)
    queue = crop_sampler.queue
    for _ in range(20):
        before = twin.queue.zeta.copy()
        crop = twin.draw()
        touched = np.unique(np.flatnonzero(twin.queue.zeta != before) // _BLOCK)
        touched = np.union1d(touched, before.argmin() // _BLOCK)
        assert len(touched) <= 3  # a tile's core of about 600 points, in 14 blocks of 512
        clean = queue._zeta.copy()
        queue._zeta[~np.isin(np.arange(len(clean)) // _BLOCK, touched)] = np.nan
        drawn = crop_sampler.draw()
        assert (drawn.tile, drawn.indices.tolist()) == (crop.tile, crop.indices.tolist())
        assert not np.isnan(queue._minima).any()
        queue._zeta[np.isnan(queue._zeta)] = clean[np.isnan(queue._zeta)]
    np.testing.assert_array_equal(queue.zeta, twin.queue.zeta)


def test_tiles_long_unused_are_put_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crops, "OPEN_VOXELS", 2 * 800)
    tiles = [tile(seed) for seed in range(4)]
    loads: list[int] = []

    def load(number: int) -> SimpleNamespace:
        loads.append(number)
        return tiles[number]

    sizes = [int(each.is_core.sum()) for each in tiles]
    ones = class_weights(np.zeros(1, np.int64))
    limited = CropSampler(sizes, load, SIZE, ones, np.random.default_rng(0))
    drawn = [(crop.tile, crop.indices.tolist()) for crop in limited.draws(40)]
    assert len(limited._open) == 2
    assert 4 < len(loads) < 40
    monkeypatch.setattr(crops, "OPEN_VOXELS", 32 * 800)
    assert drawn == [(crop.tile, crop.indices.tolist()) for crop in sampler(tiles).draws(40)]


def coverage(
    tiles: list[SimpleNamespace], draw: Callable[[], tuple[int, np.ndarray]]
) -> tuple[int, float]:
    """Draws until every core point was seen, and how often one was seen on average."""
    seen = [np.zeros(len(each.xyz), dtype=int) for each in tiles]
    core = [each.is_core for each in tiles]
    num_draws = 0
    while any((counts[inner] == 0).any() for counts, inner in zip(seen, core, strict=True)):
        number, indices = draw()
        seen[number][indices] += 1
        num_draws += 1
    visits = np.concatenate([counts[inner] for counts, inner in zip(seen, core, strict=True)])
    return num_draws, float(visits.mean())


@pytest.mark.parametrize("seed", range(4))
def test_mrs_covers_a_scene_in_fewer_draws_with_fewer_repeats_than_random(seed: int) -> None:
    tiles = [tile(100 + 10 * seed + number) for number in range(3)]
    mrs = sampler(tiles, seed=seed)

    def draw_mrs() -> tuple[int, np.ndarray]:
        crop = mrs.draw()
        return crop.tile, crop.indices

    rng = np.random.default_rng(seed)
    centers = [
        (number, row) for number in range(3) for row in np.flatnonzero(tiles[number].is_core)
    ]
    trees = [NeighborIndex(each.xyz) for each in tiles]

    def draw_random() -> tuple[int, np.ndarray]:
        number, row = centers[rng.integers(len(centers))]
        return number, trees[number].query(tiles[number].xyz[row : row + 1], SIZE)[0]

    mrs_draws, mrs_visits = coverage(tiles, draw_mrs)
    random_draws, random_visits = coverage(tiles, draw_random)
    assert mrs_draws < 0.7 * random_draws
    assert mrs_visits < 0.7 * random_visits
