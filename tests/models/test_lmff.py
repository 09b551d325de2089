import copy
import math
from dataclasses import replace

import pytest
import torch

from bushseg.config import NetworkConfig
from bushseg.models.attention import ATTENTION
from bushseg.models.layers import gather
from bushseg.models.lmff import (
    FusionBlock,
    Geometry,
    describe,
    describe_fast,
    encode_position,
    moments,
)

XYZ = torch.tensor([[1.0, 2.0, 3.0], [1.0, 5.0, 7.0], [0.0, 2.0, 3.0]])
NEIGHBORS = torch.tensor([[0, 1], [1, 2], [2, 0]])


def test_relative_position_by_hand():
    found = encode_position(XYZ, NEIGHBORS, absolute=False)
    assert found.shape == (3, 2, 4)
    assert found[0].tolist() == [[0, 0, 0, 0], [0, -3, -4, 5]]
    assert found[1, 1].tolist() == pytest.approx([1, 3, 4, math.sqrt(26)])
    assert found[2, 1].tolist() == [-1, 0, 0, 1]


def test_absolute_position_by_hand():
    found = encode_position(XYZ, NEIGHBORS, absolute=True)
    assert found.shape == (3, 2, 10)
    assert found[0, 1].tolist() == [1, 2, 3, 1, 5, 7, 0, -3, -4, 5]
    torch.testing.assert_close(found[..., 6:], encode_position(XYZ, NEIGHBORS, absolute=False))


SWITCHES = [
    {},
    {"spo": False},
    {"spf": False},
    {"spo": False, "spf": False},
    {"position": "absolute"},
]


@pytest.mark.parametrize(
    ("switches", "widths"), list(zip(SWITCHES, ([4, 3], [3], [4], [], [10, 3]), strict=True))
)
def test_channels_follow_the_switches(batch_of, small, switches, widths):
    config = small(**switches)
    geometry = Geometry.of(batch_of(50).levels[0], config, with_moments=False)
    assert geometry.columns.shape == (50, 6, sum(widths) + 1)
    assert (geometry.columns[..., -1] == 1).all()
    spans = FusionBlock(4, 6, config).spans
    assert [span.stop - span.start for span in spans] == widths


@pytest.mark.parametrize("switches", SWITCHES)
def test_compiled_geometry_equals_the_plain(batch_of, small, switches):
    level = batch_of(3000, k=16).levels[0]
    same = level.neighbors.clone()
    same[:, 1] = same[:, 0]  # every point twice: no distance, no direction
    level = replace(level, neighbors=same)
    config = small(**switches)
    exact = replace(level, xyz=level.xyz.double(), normals=level.normals.double())
    found, expected = describe_fast(level, config), describe(exact, config)
    assert found.isfinite().all()
    # theta turns by 2 pi where rounding decides its sign.
    turned = (found - expected).abs() > 3
    assert turned.double().mean() < 1e-4
    torch.testing.assert_close(found[~turned], expected[~turned].float(), atol=1e-4, rtol=1e-5)


def test_moments_by_hand():
    columns = torch.tensor([[[1.0, 1.0], [2.0, 1.0]], [[3.0, 1.0], [6.0, 1.0]]])
    assert moments(columns).tolist() == [[50, 12], [12, 4]]


def test_channels_stand_side_by_side_at_equal_width(batch_of, small):
    torch.manual_seed(0)
    config = small()
    block = FusionBlock(4, 6, config).eval()
    level = batch_of(40).levels[0]
    geometry, x = Geometry.of(level, config, with_moments=False), torch.randn(40, 4)
    position, spf = (
        lift(geometry.columns[..., span])
        for lift, span in zip(block.lifts, block.spans, strict=True)
    )
    fused = torch.cat([gather(x, level.neighbors), position, spf], dim=2)
    assert fused.shape == (40, 6, 12)
    torch.testing.assert_close(block(x, geometry), block.mlp(block.attention(fused)))


@pytest.mark.parametrize("training", [False, True])
@pytest.mark.parametrize("attention", sorted(ATTENTION))
def test_single_precision_equals_double(batch_of, attention, training):
    """Double precision takes the plain path: it judges the compiled one, statistics included."""
    torch.manual_seed(0)
    config = NetworkConfig(attention=attention)
    level = batch_of(700, k=16).levels[0]
    exact = replace(level, xyz=level.xyz.double(), normals=level.normals.double())
    x = torch.randn(700, 8)
    block = FusionBlock(8, 16, config)
    block.train()(x, Geometry.of(level, config, with_moments=True))  # statistics of their own
    block.train(training)
    plain = copy.deepcopy(block).double()
    found = block(x, Geometry.of(level, config, with_moments=training))
    expected = plain(x.double(), Geometry.of(exact, config, with_moments=training))
    torch.testing.assert_close(found, expected.float(), atol=5e-5, rtol=1e-5)
    for name, buffer in block.named_buffers():
        torch.testing.assert_close(
            buffer.double(), plain.get_buffer(name).double(), atol=1e-5, rtol=1e-5
        )


def test_chunks_do_not_show(batch_of, small):
    torch.manual_seed(0)
    config, size = small(attention="se"), 5000
    block = FusionBlock(4, 6, config).eval()
    geometry = Geometry.of(batch_of(size).levels[0], config, with_moments=False)
    x = torch.randn(size, 4)
    whole = block(x, geometry)  # with gradients nothing is cut
    assert whole.requires_grad
    with torch.inference_mode():
        torch.testing.assert_close(block(x, geometry), whole.detach(), atol=1e-6, rtol=1e-5)
