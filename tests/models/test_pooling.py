import copy

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.models.pooling import attentive_pool


def plain(x, neighbors, columns, lift, score):
    """The same in a line each, (N, K, C) at once."""
    lifted = torch.nn.functional.leaky_relu(columns @ lift, 0.2)
    fused = torch.cat([x[neighbors.long()], lifted], dim=2)
    weights = torch.softmax(fused @ score.T, dim=1)
    return (weights * fused).sum(dim=1), fused.mean(dim=1)


def inputs(n, k, width, lifted, num_columns=8, seed=0, scale=1.0):
    generator = torch.Generator().manual_seed(seed)

    def random(*shape):
        return torch.randn(*shape, generator=generator)

    neighbors = torch.randint(n, (n, k), generator=generator, dtype=torch.int32)
    channels = width + lifted
    score = scale * random(channels, channels) / channels**0.5
    columns = random(n, k, num_columns)
    return random(n, width), neighbors, columns, random(num_columns, lifted), score


def doubled(tensors):
    return [t.double() if t.is_floating_point() else t for t in tensors]


def test_two_neighbors_by_hand():
    x = torch.tensor([[1.0], [3.0]])
    neighbors = torch.tensor([[0, 1], [1, 1]], dtype=torch.int32)
    columns = torch.tensor([[[1.0], [-1.0]], [[0.0], [0.0]]])
    pooled, mean = attentive_pool(x, neighbors, columns, torch.tensor([[2.0]]), torch.zeros(2, 2))
    # No score prefers any neighbor; 2 * -1 leaks through as -0.4.
    torch.testing.assert_close(pooled, torch.tensor([[2.0, 0.8], [3.0, 0.0]]))
    torch.testing.assert_close(mean, pooled)


@settings(max_examples=40, deadline=None)
@given(
    n=st.integers(1, 900),
    k=st.sampled_from([1, 3, 16]),
    width=st.integers(1, 9),
    lifted=st.integers(0, 9),
    seed=st.integers(0, 99),
)
def test_equals_the_plain_way(n, k, width, lifted, seed):
    tensors = inputs(n, k, width, lifted, seed=seed)
    with torch.no_grad():
        found, expected = attentive_pool(*tensors), plain(*doubled(tensors))
    for f, e in zip(found, expected, strict=True):
        torch.testing.assert_close(f, e.float(), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("lifted", [0, 16])
@pytest.mark.parametrize("k", [5, 16])
def test_gradients_equal_the_plain_way(lifted, k):
    tensors = inputs(1500, k, 8, lifted)  # several chunks
    exact = doubled(copy.deepcopy(tensors))
    given_back = []
    for function, these in ((attentive_pool, tensors), (plain, exact)):
        learnt = [these[0], these[3], these[4]]
        for tensor in learnt:
            tensor.requires_grad_()
        pooled, mean = function(*these)
        (pooled.sin().sum() + mean.square().sum()).backward()
        given_back.append([tensor.grad for tensor in learnt])
    for f, e in zip(*given_back, strict=True):
        torch.testing.assert_close(f, e.float(), atol=2e-4, rtol=2e-4)


def test_gradients_are_the_same_each_time():
    def once():
        tensors = inputs(3000, 16, 8, 16)
        tensors[0].requires_grad_()
        attentive_pool(*tensors)[0].square().sum().backward()
        return tensors[0].grad

    assert torch.equal(once(), once())


@pytest.mark.parametrize("scale", [100.0, 1e4])
def test_huge_scores_neither_overflow_nor_vanish(scale):
    tensors = inputs(200, 16, 8, 16, scale=scale)
    for sign in (1, -1):
        these = [*tensors[:4], sign * tensors[4]]
        found, expected = attentive_pool(*these), plain(*doubled(these))
        torch.testing.assert_close(found[0], expected[0].float(), atol=1e-2, rtol=1e-3)
        assert found[0].isfinite().all()


@pytest.mark.parametrize("score", [80.0, 87.0, 88.5, 200.0, -200.0])
@pytest.mark.parametrize("value", [1e-3, 1e3])
def test_sums_at_the_edge_of_float32(score, value):
    """Each exponential is finite or nearly so, but their sum, or times a value, need not be."""
    tensors = list(inputs(100, 16, 8, 16))
    tensors[0] = torch.full_like(tensors[0], value)
    tensors[2] = torch.zeros_like(tensors[2])  # nothing but features
    tensors[4] = torch.full_like(tensors[4], score / (value * tensors[0].shape[1]))
    pooled, _ = attentive_pool(*tensors)
    width = tensors[0].shape[1]
    torch.testing.assert_close(pooled[:, :width], torch.full((100, width), value))
    assert not pooled[:, width:].any()


def test_nan_stays_where_it_is():
    tensors = inputs(50, 4, 3, 0)
    tensors[0][7] = float("nan")
    pooled, _ = attentive_pool(*tensors)
    touched = (tensors[1] == 7).any(dim=1)
    assert pooled[touched].isnan().any(dim=1).all()
    assert pooled[~touched].isfinite().all()
