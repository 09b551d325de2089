"""A network applied to one tile: the step that validation and prediction share."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from bushseg.config import Precision
from bushseg.features import FEATURES
from bushseg.models.batch import Batch
from bushseg.models.bushnet import BushNet
from bushseg.models.chunks import serial_torch
from bushseg.models.precision import multiplying_in
from bushseg.tile_data import NetworkTile


def feature_matrix(
    features: Mapping[str, NDArray[np.float32]], names: Sequence[str], num_points: int
) -> NDArray[np.float32]:
    """The columns a network takes, zeros (the neutral value) for a feature the scan lacks.

    Args:
        features: Feature name to (N, columns).
        names: The network's features, in order.
        num_points: N.

    Returns:
        Shape (N, F), float32.
    """
    columns = [
        features[name] if name in features else np.zeros((num_points, FEATURES[name]), np.float32)
        for name in names
    ]
    return np.concatenate(columns, axis=1)


def tile_logits(
    network: BushNet,
    tile: NetworkTile,
    features: Sequence[str],
    voxel_size: float,
    precision: Precision = "auto",
) -> NDArray[np.float32]:
    """Class scores of a tile's core.

    Args:
        network: In evaluation mode.
        tile: The tile.
        features: The network's features, in order.
        voxel_size: Metres.
        precision: How matrices are multiplied.

    Returns:
        Logits of the core's voxels, in the tile's order, shape (core, C), float32.

    Raises:
        MemoryError: The tile's features don't fit.
    """
    batch = Batch.from_numpy(
        feature_matrix(tile.features, features, len(tile)),
        tile.xyz,
        tile.normals,
        tile.pyramid,
        voxel_size,
    )
    device = next(network.parameters()).device
    # Cores are shared out over chunks of points: PyTorch's own threads would only wait in between.
    try:
        with torch.inference_mode(), serial_torch(), multiplying_in(precision):
            logits = network(batch.to(device))[torch.from_numpy(tile.is_core).to(device)]
    except RuntimeError as error:  # PyTorch has no error of its own for this on a CPU
        if "allocate memory" in str(error) or "out of memory" in str(error):
            raise MemoryError from error
        raise
    return logits.float().cpu().numpy()


def probabilities(logits: NDArray[np.float32], temperature: float = 1.0) -> NDArray[np.float32]:
    """Softmax of logits / temperature over the last axis, (N, C) -> (N, C)."""
    return torch.softmax(torch.from_numpy(logits) / temperature, dim=-1).numpy()
