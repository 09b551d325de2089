"""Class-weighted cross-entropy; unlabelled points are ignored."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn


def loss_weights(class_counts: NDArray[np.integer[Any]], how: str) -> Tensor:
    """Weight of each class in the loss, of mean 1 over the classes that occur.

    Args:
        class_counts: Labelled points per class, shape (C,).
        how: "sqrt" (1 / sqrt(f) of the class's share f), "inverse" (1 / f) or "none".

    Returns:
        Shape (C,), float32; 0 for a class that doesn't occur.
    """
    present = class_counts > 0
    shares = class_counts[present] / max(class_counts.sum(), 1)
    power = {"sqrt": -0.5, "inverse": -1.0, "none": 0.0}[how]
    weights = np.zeros(len(class_counts), dtype=np.float32)
    if present.any():
        weights[present] = shares**power / (shares**power).mean()
    return torch.from_numpy(weights)


def weighted_cross_entropy(logits: Tensor, labels: Tensor, weights: Tensor) -> Tensor:
    """Mean over the labelled points, each weighted by its class.

    Args:
        logits: Class scores, (N, C).
        labels: Class indices, -1 for unlabelled, (N,) int64.
        weights: From :func:`loss_weights`, (C,).

    Returns:
        A scalar; 0 where nothing is labelled (torch's own mean would be NaN).
    """
    total = nn.functional.cross_entropy(logits, labels, weights, ignore_index=-1, reduction="sum")
    known = labels[labels >= 0]
    return total / weights[known].sum().clamp_min(1e-12)
