"""MRS (section 3.2): eq. 3 by hand, the queue against a plain search, decimation's promises."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.config import Sampling
from bushseg.neighbors import NeighborIndex
from bushseg.sampling import ZetaQueue, decimate, hash_uniform, raise_by_distance
from bushseg.scratch import Scratch

METHODS: tuple[Sampling, ...] = ("mrs", "random")


def test_a_draw_raises_its_center_by_w_and_its_farthest_by_nothing() -> None:
    raised = raise_by_distance(np.array([0.0, 1.0, 3.0, 4.0]), 0.5)
    # sqrt(1 - d / 4) / 2 at d = 0, 1, 3, 4
    np.testing.assert_allclose(raised, [0.5, np.sqrt(3) / 4, 0.25, 0], rtol=1e-15)


def test_w_is_each_points_own() -> None:
    raised = raise_by_distance(np.array([[0.0, 0.75, 1.0], [2.0, 0.0, 1.5]]), np.array([0.2, 1, 9]))
    np.testing.assert_allclose(raised, [[0.2, 0.5, 0], [0, 1, 4.5]], rtol=1e-15)


@pytest.mark.parametrize("count", [1, 5])
def test_a_draw_without_extent_raises_by_all_of_w(count: int) -> None:
    assert raise_by_distance(np.zeros(count, np.float32), 0.25).tolist() == [0.25] * count


@settings(deadline=None)
@given(
    count=st.integers(1, 1600),
    rounds=st.lists(
        st.tuples(st.integers(0, 2**32 - 1), st.floats(0, 2), st.booleans()), max_size=12
    ),
)
def test_the_queue_finds_what_a_plain_search_finds(
    count: int, rounds: list[tuple[int, float, bool]]
) -> None:
    queue = ZetaQueue(count, np.random.default_rng(0))
    plain = queue.zeta.copy()
    assert ((plain >= 0) & (plain < 1)).all()
    for seed, amount, with_smallest in rounds:
        assert queue.smallest() == plain.argmin()
        rng = np.random.default_rng(seed)
        indices = rng.permutation(count)[: rng.integers(0, 40)]
        if with_smallest:
            indices = np.union1d(indices, plain.argmin())
        amounts = rng.random(len(indices)) * amount
        queue.add(indices, amounts)
        plain[indices] += amounts
    assert queue.smallest() == plain.argmin()
    np.testing.assert_array_equal(queue.zeta, plain)


def test_zeta_in_a_file_is_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bushseg.scratch.BLOCK_ROWS", 1024)
    monkeypatch.setattr("bushseg.sampling._RELEASED_AFTER", 2)
    rng, other = (np.random.default_rng(5) for _ in range(2))
    here, there = ZetaQueue(2_900, rng), ZetaQueue(2_900, other, Scratch(tmp_path))
    assert (tmp_path / "zeta").exists()
    assert rng.random() == other.random()
    for seed in range(9):
        np.testing.assert_array_equal(here.zeta, there.zeta)
        assert here.smallest() == there.smallest()
        indices = np.random.default_rng(seed).permutation(2_900)[:40]
        indices = np.union1d(indices, here.smallest())
        for queue in (here, there):
            queue.add(indices, np.full(len(indices), 0.3))


def test_zeta_is_for_reading() -> None:
    queue = ZetaQueue(10, np.random.default_rng(0))
    with pytest.raises(ValueError, match="read-only"):
        queue.zeta[0] = 0


def test_hashed_zeta_is_uniform() -> None:
    # Consecutive keys: the worst a poor mix could be given.
    zeta = hash_uniform(np.arange(100_000), seed=3)
    assert ((zeta >= 0) & (zeta < 1)).all()
    shares = np.histogram(zeta, bins=50, range=(0, 1))[0] / len(zeta) * 50
    assert np.abs(shares - 1).max() < 0.1  # 4.5 standard deviations
    assert abs(np.corrcoef(zeta[1:], zeta[:-1])[0, 1]) < 0.02
    other = hash_uniform(np.arange(100_000), seed=4)
    assert abs(np.corrcoef(zeta, other)[0, 1]) < 0.02


def test_a_keys_zeta_does_not_depend_on_the_other_keys() -> None:
    keys = np.random.default_rng(0).integers(0, 2**63 - 1, 1000)
    zeta = hash_uniform(keys, seed=1)
    part = np.arange(0, 1000, 7)
    np.testing.assert_array_equal(hash_uniform(keys[part], seed=1), zeta[part])
    assert (hash_uniform(keys, seed=2) != zeta).all()


class Field:
    """Points on a plane, in cells of a grid, as decimation is given them."""

    def __init__(self, seed: int, count: int = 3_000) -> None:
        rng = np.random.default_rng(seed)
        points = np.column_stack([rng.random((count, 2)) * 4, np.zeros(count)])
        cells = points[:, 0].astype(np.int64) * 4 + points[:, 1].astype(np.int64)
        order = np.argsort(cells, kind="stable")
        self.cells, self.xyz = cells[order], points[order].astype(np.float32)
        self.neighbors = NeighborIndex(self.xyz).query(self.xyz, 16)
        self.zeta = hash_uniform(np.arange(count), seed)

    def decimate(self, sampling: Sampling, decimation: int = 4) -> np.ndarray:
        return decimate(self.zeta, self.cells, decimation, self.xyz, self.neighbors, sampling)


def plain_mrs(field: Field, decimation: int) -> np.ndarray:
    """The survivors, by NumPy: sorted through in each round, cell by cell."""
    current, taken = field.zeta.copy(), np.zeros(len(field.zeta), dtype=bool)
    members = [np.flatnonzero(field.cells == cell) for cell in np.unique(field.cells)]
    quotas = [
        int(len(rows) / decimation + np.sqrt(field.zeta[rows[0]]) * 1e3 % 1) for rows in members
    ]
    for last in range(1, 5):
        picks: list[int] = []
        for rows, quota in zip(members, quotas, strict=True):
            share = quota * last // 4 - quota * (last - 1) // 4
            rows = rows[~taken[rows]]
            picks += np.sort(rows[np.argsort(current[rows], kind="stable")[:share]]).tolist()
        taken[picks] = True
        around = field.neighbors[picks]
        distances = np.linalg.norm(field.xyz[around] - field.xyz[picks][:, None], axis=2)
        np.add.at(current, around, raise_by_distance(distances))
    return np.flatnonzero(taken)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 1000), count=st.integers(1, 2000), decimation=st.integers(2, 16))
def test_mrs_takes_what_plain_rounds_take(seed: int, count: int, decimation: int) -> None:
    field = Field(seed, count)
    expected = plain_mrs(field, decimation)
    kept = field.decimate("mrs", decimation)
    assert kept.tolist() == expected.tolist() or (not len(expected) and len(kept) == 1)


@pytest.mark.parametrize("few", [0, 10**9])
def test_threads_change_no_survivor(few: int, monkeypatch: pytest.MonkeyPatch) -> None:
    field = Field(2, 5_000)
    expected = field.decimate("mrs")
    monkeypatch.setattr("bushseg.decimation._FEW", few)
    np.testing.assert_array_equal(field.decimate("mrs"), expected)


def test_equal_zeta_and_points_in_one_place_keep_the_share() -> None:
    xyz, neighbors = np.zeros((40, 3), np.float32), np.tile(np.arange(16, dtype=np.int32), (40, 1))
    kept = decimate(np.full(40, 0.25), np.zeros(40, np.int64), 4, xyz, neighbors)
    assert len(kept) in (10, 11)
    assert (np.diff(kept) > 0).all()


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 1000),
    count=st.integers(1, 700),
    decimation=st.integers(2, 16),
    sampling=st.sampled_from(METHODS),
)
def test_survivors_are_ascending_about_the_share_and_always_the_same(
    seed: int, count: int, decimation: int, sampling: Sampling
) -> None:
    field = Field(seed, count)
    zeta = field.zeta.copy()
    kept = field.decimate(sampling, decimation)
    assert kept.dtype == np.int32
    assert (np.diff(kept) > 0).all()
    assert 0 <= kept[0] <= kept[-1] < count
    np.testing.assert_array_equal(field.decimate(sampling, decimation), kept)
    np.testing.assert_array_equal(field.zeta, zeta)
    expected = count / decimation
    # MRS rounds once in each of 16 cells; plain random is binomial.
    slack = 16 if sampling == "mrs" else 6 * np.sqrt(expected) + 1
    assert abs(len(kept) - expected) <= slack


@pytest.mark.parametrize("sampling", METHODS)
def test_over_many_points_the_share_is_kept(sampling: Sampling) -> None:
    share = np.mean([len(Field(seed).decimate(sampling)) / 3_000 for seed in range(10)])
    assert share == pytest.approx(0.25, abs=0.01)


def test_mrs_takes_its_share_of_every_cell() -> None:
    field = Field(0)
    sizes = np.bincount(field.cells)
    kept = np.bincount(field.cells[field.decimate("mrs")], minlength=len(sizes))
    assert ((kept >= sizes // 4) & (kept <= sizes // 4 + 1)).all()


def test_random_takes_the_smallest_zeta() -> None:
    field = Field(1)
    kept = field.decimate("random")
    assert field.zeta[kept].max() < np.delete(field.zeta, kept).min()


@pytest.mark.parametrize("sampling", METHODS)
def test_at_least_one_point_survives(sampling: Sampling) -> None:
    for seed in range(20):
        assert len(Field(seed, 1).decimate(sampling, 16)) == 1
        assert len(Field(seed, 3).decimate(sampling, 16)) >= 1


def test_mrs_leaves_survivors_farther_apart_than_random_does() -> None:
    def spacing(field: Field, sampling: Sampling) -> float:
        xyz = field.xyz[field.decimate(sampling)]
        other = NeighborIndex(xyz).query(xyz, 2)[:, 1]
        return float(np.linalg.norm(xyz - xyz[other], axis=1).mean())

    ratios = []
    for seed in range(8):
        field = Field(seed)
        ratios.append(spacing(field, "mrs") / spacing(field, "random"))
    assert np.mean(ratios) > 1.07
    assert min(ratios) > 1
