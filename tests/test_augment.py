import numpy as np
import pytest

from bushseg.augment import augment
from bushseg.config import AugmentConfig
from bushseg.dataset import Sample
from bushseg.pyramid import Pyramid

OFF = AugmentConfig(rotate=False, scale=0, jitter=0, color_jitter=0, feature_dropout=0)
SPACING = 0.1


@pytest.fixture
def sample() -> Sample:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(300, 3)).astype(np.float32)
    return Sample(
        xyz=rng.normal(size=(300, 3)).astype(np.float32),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        features={
            "rgb": rng.uniform(-0.5, 0.5, (300, 3)).astype(np.float32),
            "intensity": rng.normal(size=(300, 1)).astype(np.float32),
            "height": rng.uniform(0, 1, (300, 1)).astype(np.float32),
        },
        labels=rng.integers(-1, 3, 300),
        pyramid=Pyramid((), (), ()),
    )


def run(sample: Sample, seed: int = 0, **settings) -> Sample:
    config = OFF.model_copy(update=settings)
    return augment(sample, config, SPACING, np.random.default_rng(seed))


def test_nothing_asked_nothing_done(sample):
    found = run(sample)
    np.testing.assert_array_equal(found.xyz, sample.xyz)
    np.testing.assert_array_equal(found.normals, sample.normals)
    for name, columns in sample.features.items():
        np.testing.assert_array_equal(found.features[name], columns)


def test_the_sample_itself_labels_and_indices_stay(sample):
    before = sample.xyz.copy(), sample.normals.copy(), sample.features["rgb"].copy()
    found = augment(sample, AugmentConfig(), SPACING, np.random.default_rng(1))
    after = sample.xyz, sample.normals, sample.features["rgb"]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert found.labels is sample.labels
    assert found.pyramid is sample.pyramid
    assert found.xyz.dtype == found.normals.dtype == np.float32


def test_rotation_is_about_z_and_turns_normals_too(sample):
    found = run(sample, rotate=True)
    np.testing.assert_allclose(found.xyz[:, 2], sample.xyz[:, 2])
    np.testing.assert_allclose(found.normals[:, 2], sample.normals[:, 2])
    before = np.einsum("ij,ij->i", sample.xyz, sample.normals)
    np.testing.assert_allclose(np.einsum("ij,ij->i", found.xyz, found.normals), before, atol=1e-5)
    assert np.abs(found.xyz - sample.xyz).max() > 0.1
    # A rotation, not a mirror image.
    cross = np.cross(found.xyz[0], found.xyz[1])[2] / np.cross(sample.xyz[0], sample.xyz[1])[2]
    assert cross == pytest.approx(1, abs=1e-4)


def test_scale_takes_height_with_it_and_leaves_normals(sample):
    found = run(sample, scale=0.5)
    factor = found.xyz[0, 0] / sample.xyz[0, 0]
    assert 0.5 <= factor <= 1.5
    assert factor != 1
    np.testing.assert_allclose(found.xyz, sample.xyz * factor, rtol=1e-5)
    np.testing.assert_allclose(
        found.features["height"], sample.features["height"] * factor, rtol=1e-5
    )
    np.testing.assert_array_equal(found.normals, sample.normals)


def test_jitter_stays_within_two_sigma_of_the_spacing(sample):
    moved = run(sample, jitter=0.2).xyz - sample.xyz
    assert 0.01 < moved.std() < 0.03
    assert np.abs(moved).max() <= 2 * 0.2 * SPACING + 1e-6


def test_colors_stay_in_range(sample):
    found = run(sample, color_jitter=0.8).features["rgb"]
    assert found.min() >= -1
    assert found.max() <= 1
    assert not np.array_equal(found, sample.features["rgb"])


def test_dropped_features_are_zero_and_height_is_never_dropped(sample):
    found = run(sample, feature_dropout=1).features
    assert not found["rgb"].any()
    assert not found["intensity"].any()
    np.testing.assert_array_equal(found["height"], sample.features["height"])


def test_features_drop_independently_and_about_as_often_as_asked(sample):
    rng = np.random.default_rng(3)
    config = OFF.model_copy(update={"feature_dropout": 0.3})
    found = [augment(sample, config, SPACING, rng).features for _ in range(400)]
    gone = np.array([[not f["rgb"].any(), not f["intensity"].any()] for f in found])
    assert 0.2 < gone[:, 0].mean() < 0.4
    assert 0.2 < gone[:, 1].mean() < 0.4
    assert 0.03 < gone.all(axis=1).mean() < 0.16


def test_same_generator_same_result(sample):
    full = AugmentConfig()
    first, again, other = (
        augment(sample, full, SPACING, np.random.default_rng(seed)) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first.xyz, again.xyz)
    np.testing.assert_array_equal(first.features["rgb"], again.features["rgb"])
    assert not np.array_equal(first.xyz, other.xyz)
