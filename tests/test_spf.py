import math

import numpy as np
import pytest
import torch

from bushseg.spf import simple_point_features


def loop(xyz: np.ndarray, normals: np.ndarray, neighbors: np.ndarray) -> np.ndarray:
    """Eq. 4-9 as they stand, one pair at a time."""
    result = np.zeros((*neighbors.shape, 3))
    for i, row in enumerate(neighbors):
        for j, k in enumerate(row):
            d = math.dist(xyz[k], xyz[i])
            if d == 0:
                continue
            e = (xyz[k] - xyz[i]) / d
            u = normals[i]
            v = np.cross(u, e)
            w = np.cross(u, v)
            result[i, j] = v @ normals[k], u @ e, math.atan2(w @ normals[k], u @ normals[k])
    return result


def random_cloud(seed: int, size: int = 40, k: int = 6) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(size, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.normal(size=(size, 3)), normals, rng.integers(0, size, (size, k))


def spf(xyz: np.ndarray, normals: np.ndarray, neighbors: np.ndarray) -> np.ndarray:
    tensors = map(torch.from_numpy, (xyz, normals, neighbors))
    return simple_point_features(*tensors).numpy()


@pytest.mark.parametrize(
    ("offset", "normal", "expected"),
    [
        # On a plane: nothing turns.
        ((2, 0, 0), (0, 0, 1), (0, 0, 0)),
        # e = x: v = z x x = y, w = z x y = -x.
        ((2, 0, 0), (0, 1, 0), (1, 0, 0)),
        ((2, 0, 0), (1, 0, 0), (0, 0, -math.pi / 2)),
        ((2, 0, 0), (-1, 0, 0), (0, 0, math.pi / 2)),
        ((2, 0, 0), (0.6, 0, 0.8), (0, 0, -math.atan2(0.6, 0.8))),
        # Straight above: u x e vanishes.
        ((0, 0, 3), (0, 0, 1), (0, 1, 0)),
        ((0, 0, -3), (0, 0, -1), (0, -1, math.pi)),
        # At 45 degrees v is not of unit length: it stays as printed.
        ((1, 0, 1), (0, 1, 0), (math.sqrt(0.5), math.sqrt(0.5), 0)),
    ],
)
def test_two_points_by_hand(offset, normal, expected):
    xyz = np.array([(5.0, -3.0, 1.0), np.add((5.0, -3.0, 1.0), offset)])
    normals = np.array([(0.0, 0.0, 1.0), np.array(normal, dtype=float)])
    found = spf(xyz, normals, np.array([[1], [0]]))
    np.testing.assert_allclose(found[0, 0], expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_equals_the_plain_loop(seed):
    cloud = random_cloud(seed)
    np.testing.assert_allclose(spf(*cloud), loop(*cloud), atol=1e-12)


def test_single_precision_is_close_enough():
    xyz, normals, neighbors = random_cloud(5)
    found = spf(xyz.astype(np.float32), normals.astype(np.float32), neighbors)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, loop(xyz, normals, neighbors), atol=1e-4)


def test_the_point_itself_and_duplicates_give_zeros():
    xyz = np.array([(1.0, 2.0, 3.0), (1.0, 2.0, 3.0)])
    normals = np.array([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
    found = spf(xyz, normals, np.array([[0, 1], [0, 1]]))
    assert (found == 0).all()


@pytest.mark.parametrize("change", ["rotated", "moved", "scaled"])
def test_does_not_depend_on(change):
    xyz, normals, neighbors = random_cloud(7)
    matrix = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
    matrix *= np.sign(np.linalg.det(matrix))  # a rotation, no mirror
    changed = {
        "rotated": (xyz @ matrix.T, normals @ matrix.T),
        "moved": (xyz + np.array([10, -20, 30]), normals),
        "scaled": (xyz * 4.5, normals),
    }[change]
    np.testing.assert_allclose(spf(*changed, neighbors), spf(xyz, normals, neighbors), atol=1e-9)


def test_a_mirror_image_turns_alpha():
    xyz, normals, neighbors = random_cloud(9)
    mirror = np.array([-1, 1, 1])
    found, mirrored = spf(xyz, normals, neighbors), spf(xyz * mirror, normals * mirror, neighbors)
    np.testing.assert_allclose(mirrored, found * [-1, 1, 1], atol=1e-12)
