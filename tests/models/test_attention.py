import math

import pytest
import torch
from torch import nn

from bushseg.models.attention import ATTENTION, AttentivePooling, ChannelGate, MultiChannelAttention

WIDTH = 12


@pytest.fixture(params=sorted(ATTENTION))
def attention(request) -> nn.Module:
    torch.manual_seed(3)
    return ATTENTION[request.param](WIDTH).double()


def neighborhoods(seed: int = 0, n: int = 5, k: int = 7) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(n, k, WIDTH, generator=generator, dtype=torch.float64)


def sigmoid(value: float) -> float:
    return 1 / (1 + math.exp(-value))


def test_channel_gate_by_hand():
    gate = ChannelGate()
    with torch.no_grad():
        gate.weight.copy_(torch.tensor([1.0, 10.0, 100.0]))
    # Two neighbors; the means over them are 0.01, 0.02, -0.03.
    x = torch.tensor([[[0.00, 0.01, -0.05], [0.02, 0.03, -0.01]]])
    expected = [
        sigmoid(10 * 0.01 + 100 * 0.02),  # zero beyond the first channel
        sigmoid(0.01 + 10 * 0.02 - 100 * 0.03),
        sigmoid(0.02 - 10 * 0.03),  # zero beyond the last
    ]
    assert gate(x).tolist()[0] == pytest.approx(expected, rel=1e-6)


def test_channel_gate_is_a_convolution_across_channels():
    gate, x = ChannelGate().double(), neighborhoods()
    kernel = gate.weight.view(1, 1, 3)
    expected = torch.sigmoid(nn.functional.conv1d(x.mean(dim=1)[:, None], kernel, padding=1))[:, 0]
    torch.testing.assert_close(gate(x), expected)
    assert sum(p.numel() for p in gate.parameters()) == 3


def test_mam_weights_every_neighbor_then_sums():
    torch.manual_seed(1)
    mam, x = MultiChannelAttention(WIDTH).double(), neighborhoods()
    weight, gate = mam.pool.score.weight, mam.gate(x)
    for i, points in enumerate(x):
        scores = torch.stack([weight @ point for point in points])  # (K, C)
        total = sum(
            gate[i] * torch.exp(scores[k]) / torch.exp(scores).sum(dim=0) * points[k]
            for k in range(len(points))
        )
        torch.testing.assert_close(mam(x)[i], total)


def test_attentive_pooling_equals_a_plain_loop():
    torch.manual_seed(2)
    pool, x = AttentivePooling(WIDTH).double(), neighborhoods()
    weight = pool.score.weight.tolist()
    found = pool(x)
    for i, points in enumerate(x.tolist()):
        for channel in range(WIDTH):
            scores = [
                math.exp(sum(w * value for w, value in zip(weight[channel], point, strict=True)))
                for point in points
            ]
            expected = sum(
                score / sum(scores) * point[channel]
                for score, point in zip(scores, points, strict=True)
            )
            assert found[i, channel].item() == pytest.approx(expected)


def test_gives_one_row_a_neighborhood(attention):
    assert attention(neighborhoods(n=5, k=7)).shape == (5, WIDTH)
    assert attention(neighborhoods(n=1, k=1)).shape == (1, WIDTH)


def test_order_of_neighbors_does_not_matter(attention):
    x = neighborhoods()
    shuffled = x[:, torch.randperm(x.shape[1], generator=torch.Generator().manual_seed(4))]
    torch.testing.assert_close(attention(shuffled), attention(x))


def test_neighborhoods_are_independent(attention):
    x = neighborhoods()
    other = torch.cat([x[:1], 100 * neighborhoods(1)[1:]])
    torch.testing.assert_close(attention(other)[0], attention(x)[0])


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e4])
def test_gradients_are_finite(attention, scale):
    x = (scale * neighborhoods()).requires_grad_()
    attention(x).square().sum().backward()
    gradients = [x.grad, *(parameter.grad for parameter in attention.parameters())]
    assert all(gradient is not None and gradient.isfinite().all() for gradient in gradients)


def test_every_parameter_has_a_say(attention):
    x = neighborhoods().requires_grad_()
    attention(x).square().sum().backward()
    assert all((parameter.grad != 0).any() for parameter in attention.parameters())
    assert (x.grad != 0).any(dim=2).all()
