"""Rows in chunks of one size."""

import threading

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from bushseg import parallel
from bushseg.models.chunks import in_chunks, serial_torch


@pytest.mark.parametrize("num_rows", [0, 1, 2, 3, 7, 10, 16, 33])
@pytest.mark.parametrize("size", [1, 3, 4, 10, 64])
def test_in_chunks_equals_the_whole(num_rows, size):
    a, b = torch.randn(num_rows, 2), torch.randn(num_rows, 3, 2)
    sizes = []

    def function(x, y):
        sizes.append(len(x))
        return x + y.sum(dim=1)

    with torch.no_grad():
        torch.testing.assert_close(in_chunks(function, 2, a, b, size=size), a + b.sum(dim=1))
    assert len(set(sizes)) == 1
    assert sizes[0] <= size
    assert sum(sizes) < num_rows + max(1, sizes[0])


def test_with_gradients_nothing_is_cut():
    sizes = []
    in_chunks(lambda x: sizes.append(len(x)) or x, 2, torch.randn(10, 2), size=3)
    assert sizes == [10]


def test_what_a_call_raises_is_raised():
    def function(x):
        if threading.current_thread() is not threading.main_thread():
            raise ZeroDivisionError
        return x

    with torch.no_grad(), pytest.raises(ZeroDivisionError):
        in_chunks(function, 2, torch.randn(10, 2), size=3)


def test_threads_are_given_back():
    before = torch.get_num_threads()
    with serial_torch():
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before


class Products(TorchDispatchMode):
    """Notes the shapes of what is multiplied."""

    def __init__(self) -> None:
        super().__init__()
        self.shapes = set()

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        if any(name in func.__name__ for name in ("mm", "linear", "matmul")):
            self.shapes.add(tuple(tuple(a.shape) for a in args if isinstance(a, torch.Tensor)))
        return func(*args, **(kwargs or {}))


def shapes_of(network, batch):
    with torch.inference_mode(), Products() as products:
        network(batch)
    return products.shapes


@pytest.mark.parametrize("attention", ["mam", "se"])
def test_products_have_the_same_shapes_in_every_tile(
    monkeypatch, batch_of, network_of, small, attention
):
    monkeypatch.setattr(parallel, "_most_cores", 1)  # a mode is a thread's own
    network = network_of(small(attention=attention))
    first = shapes_of(network, batch_of(5000))
    assert len(first) > 10
    assert shapes_of(network, batch_of(6789)) == first
