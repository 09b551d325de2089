"""Scans that hardly are any: few points, points in one place, in a line, in a plane, far astray."""

import itertools

import laspy
import numpy as np
import pytest

from bushseg.config import PredictConfig
from bushseg.errors import DataError
from bushseg.prediction import predict, predict_file

K = 8  # neighbors of the model the tests use


def lattice(*counts: int) -> np.ndarray:
    axes = (np.arange(count) * 0.4 for count in counts)
    return np.array(list(itertools.product(*axes)), dtype=np.float64)


def with_one(xyz: np.ndarray, *point: float) -> np.ndarray:
    return np.vstack([xyz, point])


SHAPES = {
    "one point": np.array([[3.0, 4, 5]]),
    "two points": np.array([[3.0, 4, 5], [3, 4, 6]]),
    "two points in one voxel": np.array([[3.0, 4, 5], [3, 4, 5.0001]]),
    "fewer than K": lattice(K - 1, 1, 1),
    "exactly K": lattice(K, 1, 1),
    "one more than K": lattice(K + 1, 1, 1),
    "all in one place": np.full((500, 3), 7.25),
    "two places": np.repeat([[0.0, 0, 0], [1, 1, 1]], 300, axis=0),
    "a line": lattice(300, 1, 1),
    "an upright line": lattice(1, 1, 300),
    "a slanting line": np.linspace(0, 90, 300)[:, None] * [1, 1, 1],
    "a plane": lattice(20, 20, 1),
    "an upright plane": lattice(1, 20, 20),
    "a block": lattice(8, 8, 8),
    "one 10 km away": with_one(lattice(8, 8, 8), 10_000, 0, 0),
    "one 10 km above": with_one(lattice(8, 8, 8), 0, 0, 10_000),
    "far from the origin": lattice(8, 8, 8) + np.array([6.6e6, 5.8e6, 100]),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_every_point_gets_a_label(height_model, shape):
    xyz = SHAPES[shape]
    labels, probabilities = predict(xyz, height_model)
    assert labels.shape == (len(xyz),)
    assert ((labels >= 0) & (labels < height_model.card.scheme.num_classes)).all()
    assert np.isfinite(probabilities).all()
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, rtol=1e-5)


@pytest.mark.parametrize("shape", SHAPES)
def test_points_in_one_place_get_one_label(height_model, shape):
    xyz = SHAPES[shape]
    once, _ = predict(xyz, height_model)
    # The first point anchors the grid, and stays first.
    twice, _ = predict(np.concatenate([xyz, xyz[::-1]]), height_model)
    assert twice[: len(xyz)].tolist() == twice[len(xyz) :][::-1].tolist()
    assert twice[: len(xyz)].tolist() == once.tolist()


@pytest.mark.parametrize(
    "bad", [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e20], ids=lambda value: f"{value:g}"
)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("first", [True, False])
def test_coordinates_out_of_reach_stay_unlabelled(height_model, bad, axis, first):
    good = lattice(6, 6, 6)
    astray = np.zeros((2, 3))
    astray[:, axis] = bad
    xyz = np.concatenate([astray, good] if first else [good, astray])
    labels, probabilities = predict(xyz, height_model)
    is_good = np.r_[np.zeros(2, bool), np.ones(len(good), bool)]
    is_good = is_good if first else is_good[::-1]
    assert (labels[~is_good] == -1).all()
    assert not probabilities[~is_good].any()
    assert (labels[is_good] >= 0).all()


@pytest.mark.parametrize("tiny", [5e-324, 1e-310, 1e-30])
def test_coordinates_next_to_nothing(height_model, tiny):
    labels, _ = predict(lattice(6, 6, 6) * tiny, height_model)
    assert (labels >= 0).all()
    assert len(set(labels.tolist())) == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_point_within_reach(height_model, value):
    with pytest.raises(DataError):
        predict(np.full((5, 3), value), height_model)


@pytest.mark.parametrize("count", [1, 2, K - 1])
def test_a_file_of_few_points(height_model, tmp_path, count):
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.header.scales = [0.01] * 3
    las.x, las.y, las.z = lattice(count, 1, 1).T
    las.write(str(tmp_path / "few.laz"))
    result = predict_file(tmp_path / "few.laz", tmp_path / "out.laz", height_model, PredictConfig())
    assert result.num_points == count
    assert len(laspy.read(tmp_path / "out.laz")) == count


def test_a_file_with_coordinates_that_are_none_keeps_and_counts_them(height_model, tmp_path):
    xyz = lattice(5, 5, 5)
    xyz[[3, 60]] = [[np.nan, 0, 0], [0, np.inf, 0]]
    path = tmp_path / "odd.csv"
    np.savetxt(path, xyz, delimiter=",", header="x,y,z", comments="")
    result = predict_file(path, tmp_path / "out.ply", height_model)
    assert (result.num_points, result.num_unlabelled) == (125, 2)
