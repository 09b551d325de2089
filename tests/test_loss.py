import math

import numpy as np
import pytest
import torch

from bushseg.loss import loss_weights, weighted_cross_entropy


@pytest.mark.parametrize(
    ("how", "expected"),
    [
        # Shares 0.64, 0, 0.36; divided by their mean.
        ("sqrt", [6 / 7, 0, 8 / 7]),
        ("inverse", [0.72, 0, 1.28]),
        ("none", [1, 0, 1]),
    ],
)
def test_weights_by_hand(how, expected):
    weights = loss_weights(np.array([640, 0, 360]), how)
    assert weights.dtype == torch.float32
    assert weights.tolist() == pytest.approx(expected)


def test_no_class_at_all():
    assert loss_weights(np.zeros(3, np.int64), "sqrt").tolist() == [0, 0, 0]


def test_loss_by_hand():
    # Probabilities of the true classes: 1/2 and 1/4; the third point has no label.
    logits = torch.log(torch.tensor([[0.5, 0.25, 0.25], [0.5, 0.25, 0.25], [0.9, 0.05, 0.05]]))
    loss = weighted_cross_entropy(logits, torch.tensor([0, 1, -1]), torch.tensor([1.0, 3.0, 1.0]))
    assert loss.item() == pytest.approx((math.log(2) + 3 * math.log(4)) / 4)


def test_unlabelled_points_teach_nothing():
    logits = torch.randn(4, 3, requires_grad=True)
    loss = weighted_cross_entropy(logits, torch.full((4,), -1), torch.ones(3))
    loss.backward()
    assert loss.item() == 0
    assert not logits.grad.any()
