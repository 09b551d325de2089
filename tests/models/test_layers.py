import pytest
import torch

from bushseg.models.layers import SharedMLP, gather


def test_gather_takes_rows_in_any_shape():
    x = torch.arange(6.0).view(3, 2)
    found = gather(x, torch.tensor([[2, 0], [1, 1]]))
    assert found.tolist() == [[[4, 5], [0, 1]], [[2, 3], [2, 3]]]


def test_shared_mlp_treats_every_point_alike():
    torch.manual_seed(0)
    mlp = SharedMLP(3, 4).eval()
    x = torch.randn(5, 7, 3)
    torch.testing.assert_close(mlp(x)[2, 3], mlp(x[2, 3][None])[0])


def test_shared_mlp_by_hand():
    mlp = SharedMLP(2, 2).eval()
    with torch.no_grad():
        mlp.linear.weight.copy_(torch.tensor([[1.0, 1.0], [1.0, -1.0]]))
    x = torch.tensor([[1.0, 3.0]])
    # A fresh normalization divides by sqrt(1 + eps); the slope below zero is 0.2.
    torch.testing.assert_close(mlp(x), torch.tensor([[4.0, -0.4]]), atol=1e-4, rtol=0)
    bare = SharedMLP(2, 2, activation=False).eval()
    bare.load_state_dict(mlp.state_dict())
    torch.testing.assert_close(bare(x), torch.tensor([[4.0, -2.0]]), atol=1e-4, rtol=0)


@pytest.mark.parametrize("activation", [True, False])
def test_fixed_statistics_merge_into_the_linear_map(activation):
    torch.manual_seed(0)
    mlp = SharedMLP(3, 4, activation=activation)
    for _ in range(3):
        mlp(2 + 3 * torch.randn(50, 3))
    mlp.eval()
    x, coarse = torch.randn(20, 3), torch.randn(20, 3)
    torch.testing.assert_close(mlp(x), mlp.finish(mlp.linear(x)))
    finish, weight = mlp.split_step()
    torch.testing.assert_close(finish(x @ weight.T + coarse @ weight.T), mlp(x + coarse))


def test_observing_moves_the_statistics_as_normalizing_does():
    torch.manual_seed(0)
    rows = torch.randn(30, 3)
    mlp, other = SharedMLP(3, 4), SharedMLP(3, 4)
    other.load_state_dict(mlp.state_dict())
    mlp(rows)
    mapped = other.linear(rows).detach().double()
    other.observe(mapped.mean(dim=0), mapped.var(dim=0, correction=0), len(rows))
    for name, buffer in other.norm.named_buffers():
        torch.testing.assert_close(buffer, mlp.norm.get_buffer(name))
