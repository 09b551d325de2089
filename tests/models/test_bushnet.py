import copy
import itertools
from dataclasses import replace

import pytest
import torch

from bushseg.config import NetworkConfig
from bushseg.models.attention import ATTENTION
from bushseg.models.batch import Batch
from bushseg.models.bushnet import BushNet, DecoderLayer, count_parameters
from bushseg.models.layers import gather

NUM_CLASSES = 5


def test_parameter_counts():
    """Those that training and users may quote: 3 + 1 + 1 input columns, 8 classes."""
    randla = count_parameters(BushNet(5, 8, NetworkConfig.randla()))
    bushnet = count_parameters(BushNet(5, 8, NetworkConfig()))
    assert set(bushnet) == {"stem", "encoder", "bottleneck", "decoder", "head", "total"}
    assert bushnet["stem"] == randla["stem"] == 5 * 8 + 2 * 8
    assert bushnet["bottleneck"] == randla["bottleneck"] == 512 * 512 + 2 * 512
    assert bushnet["head"] == (32 * 64 + 2 * 64) + (64 * 32 + 2 * 32) + (32 * 8 + 8)
    assert (randla["total"], bushnet["total"]) == (1_217_472, 1_497_416)


def test_a_fusion_block_of_bushnet_by_hand():
    """Layer 1 of the encoder: 8 -> 32, quarters of 8; three channels make 24."""
    layer = BushNet(5, 8, NetworkConfig()).encoder[0]
    lifts = (4 * 8 + 2 * 8) + (3 * 8 + 2 * 8)
    attention = 24 * 24 + 3
    first = lifts + attention + 24 * 8 + 2 * 8
    second = lifts + attention + 24 * 16 + 2 * 16
    around = (8 * 8 + 2 * 8) + (16 * 32 + 2 * 32) + (8 * 32 + 2 * 32)
    assert sum(p.numel() for p in layer.parameters()) == first + second + around


@pytest.mark.parametrize(
    ("spo", "spf", "attention", "position"),
    [
        *itertools.product([True, False], [True, False], ["mam"], ["relative", "absolute"]),
        *((True, True, name, "relative") for name in ATTENTION),
    ],
)
def test_every_switch_builds_and_learns(batch_of, network_of, small, spo, spf, attention, position):
    network = network_of(small(spo=spo, spf=spf, attention=attention, position=position)).train()
    logits = network(batch_of(60))
    assert logits.shape == (60, NUM_CLASSES)
    logits.square().mean().backward()
    gradients = [parameter.grad for parameter in network.parameters()]
    assert all(gradient is not None and gradient.isfinite().all() for gradient in gradients)


@pytest.mark.parametrize("size", [1, 5])
@pytest.mark.parametrize("num_levels", [2, 4])
def test_a_cloud_of_few_points_runs(batch_of, network_of, small, size, num_levels):
    config = small().model_copy(update={"widths": (8, 16, 16, 16)[:num_levels]})
    with torch.inference_mode():
        logits = network_of(config)(batch_of(size, num_levels=num_levels))
    assert logits.shape == (size, NUM_CLASSES)
    assert logits.isfinite().all()


@pytest.mark.parametrize("attention", sorted(ATTENTION))
def test_clouds_of_a_batch_do_not_meet(batch_of, network_of, small, attention):
    network = network_of(small(attention=attention))
    parts = [batch_of(size, seed) for seed, size in enumerate((80, 3, 150))]
    with torch.inference_mode():
        together = network(Batch.concatenated(parts))
        apart = torch.cat([network(part) for part in parts])
    torch.testing.assert_close(together, apart, atol=1e-5, rtol=1e-5)


def test_far_points_do_not_matter(batch_of, network_of, small):
    """What lies beyond the receptive field may be anything; the nearby must not."""
    network, batch = network_of(small()), batch_of(2000, num_levels=2)
    before = network(batch)
    far = batch.levels[0].xyz[:, 0] > batch.levels[0].xyz[:, 0].max() * 0.9
    near = batch.levels[0].xyz[:, 0] < batch.levels[0].xyz[:, 0].max() * 0.1
    changed = batch.features.clone()
    changed[far] += 3
    after = network(replace(batch, features=changed))
    torch.testing.assert_close(after[near], before[near], atol=0, rtol=0)
    assert (after[far] - before[far]).abs().max() > 1e-3


@pytest.mark.parametrize("position", ["relative", "absolute"])
def test_only_relative_positions_ignore_where_the_origin_is(batch_of, network_of, small, position):
    network, batch = network_of(small(position=position)), batch_of(200)
    moved = replace(
        batch, levels=tuple(replace(level, xyz=level.xyz + 8) for level in batch.levels)
    )
    with torch.inference_mode():
        difference = (network(moved) - network(batch)).abs().max()
    assert (difference < 1e-3) == (position == "relative")


def test_gradients_make_no_difference_to_the_logits(batch_of, network_of, small):
    network, batch = network_of(small()), batch_of(9000)  # more than two chunks
    with_gradients = network(batch)
    assert with_gradients.requires_grad
    with torch.inference_mode():
        torch.testing.assert_close(network(batch), with_gradients.detach(), atol=1e-5, rtol=1e-5)


def test_decoder_layer_equals_concatenation_then_the_mlp():
    torch.manual_seed(0)
    layer = DecoderLayer(6, 4, 5).double()
    coarse, skip = torch.randn(7, 6).double(), torch.randn(20, 4).double()
    interpolated = torch.randint(0, 7, (20,))
    plain = layer.mlp(torch.cat([skip, gather(coarse, interpolated)], dim=1))
    torch.testing.assert_close(layer(coarse, skip, interpolated), plain)


def test_levels_must_match_the_layers(batch_of, network_of, small):
    with pytest.raises(ValueError, match="zip"):
        network_of(small())(batch_of(50, num_levels=3))


def test_a_single_survivor_can_be_trained_on(batch_of, network_of, small):
    network, batch = network_of(small()).train(), batch_of(5)
    assert len(batch.levels[1].decimated) == 1
    before = network.bottleneck.norm.running_var.clone()
    network(batch).square().mean().backward()
    assert all(parameter.grad.isfinite().all() for parameter in network.parameters())
    assert torch.equal(network.bottleneck.norm.running_var, before)


@pytest.mark.gpu
@pytest.mark.parametrize("training", [False, True])
def test_cuda_equals_the_cpu(batch_of, network_of, small, training):
    """The same code: on CUDA the plain path in PyTorch, on the CPU the compiled one."""
    if not torch.cuda.is_available():
        pytest.skip("no CUDA here")
    device = torch.device("cuda")
    network, batch = network_of(small(dropout=0)).train(training), batch_of(3000, k=16)
    moved = copy.deepcopy(network).to(device)
    found, expected = moved(batch.to(device)).cpu(), network(batch)
    torch.testing.assert_close(found, expected, atol=1e-3, rtol=1e-3)
