"""Grid sub-sampling against five points by hand and against a plain loop."""

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg import voxel_runs
from bushseg.grid import VoxelGrid
from bushseg.subsample import GridSubsampler, Voxels

GRID = VoxelGrid(np.zeros(3), 1.0)
CLASSES = 3

# Coarse coordinates, so that points share voxels; NaN, and -1 outside the grid.
coordinate = st.sampled_from([0.0, 0.25, 0.75, 1.5, 2.25, -1.0, float("nan")])
point = st.tuples(
    coordinate, coordinate, coordinate, st.integers(0, 255), st.integers(-1, CLASSES - 1)
)


def run(
    rows: list[tuple[float, ...]],
    cuts: list[int],
    folder: Path | None = None,
    max_voxels: int = 1,
) -> tuple[Voxels, int]:
    """Sub-sample rows of x y z value label, cut into chunks."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    sampler = GridSubsampler(GRID, CLASSES, folder, max_voxels)
    for part in np.split(table, cuts):
        values = {"intensity": part[:, 3].astype(np.float32)}
        sampler.add(part[:, :3], values, part[:, 4].astype(np.int16))
    return sampler.finish(), sampler.num_outside


def test_five_points_by_hand() -> None:
    sampler = GridSubsampler(GRID, CLASSES)
    xyz = np.array([[0.2, 0.4, 0.6], [3.5, 0, 0], [0.4, 0.8, 0.2], [0.6, 0.0, 0.1], [np.nan, 0, 0]])
    values = {
        "b": np.array([1, 7, 2, 6, 9], np.float32),
        "a": np.array([0, 5, 0, 3, 9], np.float32),
    }
    sampler.add(xyz, values, np.array([2, -1, 1, 2, 0], np.int16))
    voxels = sampler.finish()
    assert sampler.num_outside == 1
    assert voxels.keys.tolist() == [0, 9]
    np.testing.assert_allclose(voxels.xyz, [[0.4, 0.4, 0.3], [3.5, 0, 0]], rtol=1e-15)
    assert voxels.values["b"].tolist() == [3, 7]
    assert voxels.values["a"].tolist() == [1, 5]
    assert voxels.counts.tolist() == [3, 1]
    assert voxels.labels is not None
    assert voxels.labels.tolist() == [2, -1]


@settings(deadline=None)
@given(st.lists(point, max_size=40), st.data())
def test_means_majorities_and_counts_equal_a_plain_loop(
    rows: list[tuple[float, ...]], data: st.DataObject
) -> None:
    cuts = sorted(data.draw(st.lists(st.integers(0, len(rows)), max_size=4)))
    voxels, num_outside = run(rows, cuts)
    members: dict[int, list[tuple[float, ...]]] = defaultdict(list)
    for row in rows:
        if all(value >= 0 for value in row[:3]):  # False for NaN
            members[int(GRID.keys(np.array([row[:3]]))[0])].append(row)
    assert voxels.keys.tolist() == sorted(members)
    assert num_outside == len(rows) - sum(map(len, members.values()))
    for index, key in enumerate(voxels.keys.tolist()):
        inside = members[key]
        assert voxels.counts[index] == len(inside)
        np.testing.assert_allclose(voxels.xyz[index], np.mean([row[:3] for row in inside], axis=0))
        np.testing.assert_allclose(
            voxels.values["intensity"][index], np.mean([row[3] for row in inside]), rtol=1e-6
        )
        votes = Counter(int(row[4]) for row in inside if row[4] >= 0)
        expected = min(votes, key=lambda label: (-votes[label], label), default=-1)
        assert voxels.labels is not None
        assert voxels.labels[index] == expected


@pytest.mark.parametrize("chunk", [1, 2, 7, 49, 50, 60])
def test_chunks_give_what_the_whole_gives(chunk: int) -> None:
    # Room is made for the first chunk's points and then doubled: often, if that chunk is small.
    rng = np.random.default_rng(chunk)
    # Multiples of 1/8 sum exactly, so that the order of the sums can't show.
    rows = np.column_stack(
        [rng.integers(0, 24, (50, 3)) / 8, rng.integers(0, 255, 50), rng.integers(-1, CLASSES, 50)]
    )
    whole, _ = run(rows.tolist(), [])
    parts, _ = run(rows.tolist(), list(range(chunk, 50, chunk)))
    for name in ("keys", "xyz", "counts", "labels"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_array_equal(parts.values["intensity"], whole.values["intensity"])


@pytest.mark.parametrize("max_voxels", [1, 3, 20, 3_000])
def test_voxels_that_memory_can_not_hold(
    max_voxels: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(voxel_runs, "_SAMPLE", 2)
    rng = np.random.default_rng(max_voxels)
    rows = np.column_stack(
        [rng.integers(0, 40, (300, 3)) / 8, rng.integers(0, 255, 300), rng.integers(-1, 3, 300)]
    )
    whole, _ = run(rows.tolist(), [])
    parts, _ = run(rows.tolist(), [7, 60, 200], tmp_path, max_voxels)
    for name in ("keys", "xyz", "counts", "labels"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    np.testing.assert_array_equal(parts.values["intensity"], whole.values["intensity"])
    assert not list(tmp_path.glob("run*"))
    assert bool(list(tmp_path.iterdir())) == (len(whole) > max_voxels)


def test_pages_of_one_run_are_let_go_before_the_next_is_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else memory would grow with the number of runs."""
    sampler = GridSubsampler(GRID, folder=tmp_path, max_voxels=40)
    sampler.add(np.random.default_rng(0).random((600, 3)) * 9, {})
    events: list[str] = []
    honest = voxel_runs._places
    monkeypatch.setattr(
        voxel_runs, "_places", lambda *given: (events.append("search"), honest(*given))[1]
    )
    monkeypatch.setattr(voxel_runs.Scratch, "release", lambda _: events.append("release"))
    sampler.finish()
    searches = [place for place, event in enumerate(events) if event == "search"]
    assert len(searches) > 10
    assert all(events[place + 1] == "release" for place in searches)


@pytest.mark.parametrize(
    ("labels", "majority"),
    [([2, 1], 1), ([2, 1, 2, 1], 1), ([-1, -1, 2], 2), ([-1, -1], -1), ([0, 2, 2], 2)],
)
def test_ties_and_unlabelled_points(labels: list[int], majority: int) -> None:
    voxels, _ = run([(0.5, 0.5, 0.5, 0, label) for label in labels], [])
    assert voxels.labels is not None
    assert voxels.labels.tolist() == [majority]


def test_every_raw_point_finds_its_voxel_and_no_other_key_does() -> None:
    rng = np.random.default_rng(0)
    xyz = rng.random((2_000, 3)) * 9
    sampler = GridSubsampler(GRID)
    sampler.add(xyz, {})
    voxels = sampler.finish()
    keys = GRID.keys(xyz)
    found = voxels.find(keys)
    np.testing.assert_array_equal(voxels.keys[found], keys)
    np.testing.assert_array_equal(np.bincount(found), voxels.counts)
    assert voxels.labels is None
    absent = np.setdiff1d(np.arange(keys.max() + 10), keys)
    assert (voxels.find(absent) == -1).all()
    assert voxels.find(np.array([-1, keys[0], -1])).tolist() == [-1, found[0], -1]
    assert voxels.find(np.empty(0, np.int64)).shape == (0,)


def test_no_points_give_no_voxels() -> None:
    voxels, num_outside = run([(float("nan"), 0, 0, 0, 0)], [])
    assert (len(voxels), num_outside) == (0, 1)
    assert voxels.xyz.shape == (0, 3)
    assert voxels.find(np.array([0, 5])).tolist() == [-1, -1]
