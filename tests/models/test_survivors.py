import pytest
import torch

from bushseg.models.survivors import pool_survivors


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_survivors_take_the_maximum_of_their_neighborhood(batch_of, dtype):
    level = batch_of(100).levels[0]
    x = torch.randn(100, 4, dtype=dtype)
    found = pool_survivors(x, level)
    for row, survivor in zip(found, level.decimated.tolist(), strict=True):
        torch.testing.assert_close(row, x[level.neighbors[survivor]].max(dim=0).values)


def test_gradients_equal_the_plain_way(batch_of):
    level = batch_of(5000, k=16).levels[0]
    x, weights = torch.randn(5000, 7), torch.randn(len(level.decimated), 7)
    gradients = []
    for dtype in (torch.float32, torch.float64):
        rows = x.to(dtype, copy=True).requires_grad_()
        (pool_survivors(rows, level) * weights).sum().backward()
        gradients.append(rows.grad.double())
    torch.testing.assert_close(*gradients, atol=1e-5, rtol=1e-5)


def test_a_tie_gives_its_gradient_once(batch_of):
    level = batch_of(60).levels[0]
    x = torch.ones(60, 3, requires_grad=True)
    pool_survivors(x, level).sum().backward()
    assert x.grad.sum() == 3 * len(level.decimated)
