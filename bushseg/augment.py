"""What training varies in a crop. Neighborhoods stay as they are, so the cached indices hold."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bushseg.config import AugmentConfig
from bushseg.dataset import Sample

DROPPABLE = ("rgb", "intensity")
"""Features a scan may lack; height is always there."""


def augment(
    sample: Sample, config: AugmentConfig, spacing: float, rng: np.random.Generator
) -> Sample:
    """Rotate about z, scale, jitter; shift colors, or drop a feature altogether.

    Args:
        sample: The crop; left unchanged.
        config: How much of each.
        spacing: The voxel size in metres, the unit of jitter.
        rng: Draws everything.

    Returns:
        A new sample of the same points, labels and indices.
    """
    transform = np.eye(3)
    if config.rotate:
        angle = rng.uniform(0, 2 * np.pi)
        transform[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    scale = rng.uniform(1 - config.scale, 1 + config.scale)
    xyz = sample.xyz @ (scale * transform.T).astype(np.float32)
    # Clipped, as a point that jumps a voxel would no longer be among its neighbors.
    noise = rng.standard_normal(xyz.shape, dtype=np.float32).clip(-2, 2)
    xyz += noise * np.float32(config.jitter * spacing)
    features = dict(sample.features)
    if "height" in features:
        features["height"] = features["height"] * np.float32(scale)
    if "rgb" in features:
        features["rgb"] = _jitter_color(features["rgb"], config.color_jitter, rng)
    for name in DROPPABLE:
        # Drawn for every feature, present or not, so that draws don't depend on what is there.
        if rng.random() < config.feature_dropout and name in features:
            features[name] = np.zeros_like(features[name])
    normals = sample.normals @ transform.T.astype(np.float32)
    return replace(sample, xyz=xyz, normals=normals, features=features)


def _jitter_color(
    rgb: NDArray[np.float32], amount: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Shift each channel as a whole and each point a little, (N, 3) in [-1, 1]."""
    shift = rng.normal(0, amount, 3).astype(np.float32)
    noise = rng.standard_normal(rgb.shape, dtype=np.float32) * np.float32(amount / 2)
    return np.clip(rgb + shift + noise, -1, 1)
