"""Batches of random points, as the networks take them."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from bushseg.config import NetworkConfig
from bushseg.grid import VoxelGrid
from bushseg.models.batch import Batch
from bushseg.models.bushnet import BushNet
from bushseg.pyramid import build_pyramid


def make_batch(
    num_points: int, seed: int = 0, *, num_levels: int = 2, num_features: int = 3, k: int = 6
) -> Batch:
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 5, (num_points, 3))
    keys = VoxelGrid.around(xyz[0], 0.1).keys(xyz)
    order = np.argsort(keys)
    xyz, keys = xyz[order].astype(np.float32), keys[order]
    normals = rng.normal(size=xyz.shape).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    pyramid = build_pyramid(
        xyz, keys, num_neighbors=k, num_levels=num_levels, decimation=4, sampling="mrs", seed=0
    )
    features = rng.normal(size=(num_points, num_features)).astype(np.float32)
    return Batch.from_numpy(features, xyz, normals, pyramid, spacing=0.1)


@pytest.fixture
def batch_of() -> Callable[..., Batch]:
    return make_batch


@pytest.fixture
def small() -> Callable[..., NetworkConfig]:
    """Two narrow layers; switches as given."""
    return lambda **switches: NetworkConfig(widths=(8, 16), head_widths=(8, 8), **switches)


def make_network(config: NetworkConfig) -> BushNet:
    """Three features, five classes, random weights; normalized to what random clouds give.

    A fresh network in evaluation mode fades its signal from layer to layer, and tests with it.
    """
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = BushNet(3, 5, config)
        for module in network.modules():
            if isinstance(module, torch.nn.BatchNorm1d):
                module.momentum = 1.0
        network(make_batch(600, seed=99, num_levels=len(config.widths)))
    return network.eval()


@pytest.fixture
def network_of() -> Callable[[NetworkConfig], BushNet]:
    return make_network
