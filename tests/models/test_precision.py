import copy

import pytest
import torch

from bushseg.models.precision import has_bfloat16_units, multiplying_in

A, B = torch.rand(512, 64), torch.rand(64, 128)
EXACT = A.double() @ B.double()


def error():
    return ((A @ B).double() - EXACT).abs().max().item()


def test_float32_is_exact_and_left_as_it_was():
    with multiplying_in("float32"):
        assert error() < 1e-4
    assert error() < 1e-4


@pytest.mark.skipif(not has_bfloat16_units(), reason="no bfloat16 units here")
@pytest.mark.parametrize("precision", ["auto", "bfloat16"])
def test_bfloat16_rounds_factors_and_ends_with_the_block(precision):
    def fail():
        with multiplying_in(precision):
            assert 1e-4 < error() < 0.5
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert error() < 1e-4


def test_bfloat16_changes_hardly_any_label(batch_of, network_of, small):
    network, batch = network_of(small()), batch_of(4000)
    labels = []
    for precision in ("float32", "bfloat16"):
        with torch.inference_mode(), multiplying_in(precision):
            labels.append(copy.copy(network(batch).argmax(dim=1)))
    assert (labels[0] == labels[1]).double().mean() > 0.98
