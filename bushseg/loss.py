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


def total_weight(labels: Tensor, weights: Tensor) -> Tensor:
    """What labelled points weigh together.

    Args:
        labels: Class indices, -1 for unlabelled, (N,) int64.
        weights: From :func:`loss_weights`, (C,).

    Returns:
        A scalar.
    """
    return weights[labels[labels >= 0]].sum()


def weighted_cross_entropy(
    logits: Tensor, labels: Tensor, weights: Tensor, total: Tensor | None = None
) -> Tensor:
    """Mean over the labelled points, each weighted by its class.

    Args:
        logits: Class scores, (N, C).
        labels: Class indices, -1 for unlabelled, (N,) int64.
        weights: From :func:`loss_weights`, (C,).
        total: What to divide by, where these are but a part of the points the mean is taken over;
            None takes their own :func:`total_weight`.

    Returns:
        A scalar; 0 where nothing is labelled (torch's own mean would be NaN).
    """
    summed = nn.functional.cross_entropy(logits, labels, weights, ignore_index=-1, reduction="sum")
    return summed / (total_weight(labels, weights) if total is None else total).clamp_min(1e-12)
