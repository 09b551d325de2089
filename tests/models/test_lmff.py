import math

import pytest
import torch

from bushseg.models.layers import gather
from bushseg.models.lmff import CHUNK, FusionBlock, Geometry, encode_position

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


@pytest.mark.parametrize(
    ("switches", "columns"),
    [
        ({}, [4, 3]),
        ({"spo": False}, [3]),
        ({"spf": False}, [4]),
        ({"spo": False, "spf": False}, []),
    ],
)
def test_channels_follow_the_switches(batch_of, small, switches, columns):
    geometry = Geometry.of(batch_of(50).levels[0], small(**switches))
    assert [column.shape[2] for column in geometry.columns] == columns


def test_channels_stand_side_by_side_at_equal_width(batch_of, small):
    torch.manual_seed(0)
    config = small()
    block = FusionBlock(4, 6, config).eval()
    level = batch_of(40).levels[0]
    geometry, x = Geometry.of(level, config), torch.randn(40, 4)
    position, spf = (lift(c) for lift, c in zip(block.lifts, geometry.columns, strict=True))
    fused = torch.cat([gather(x, level.neighbors), position, spf], dim=2)
    assert fused.shape == (40, 6, 12)
    torch.testing.assert_close(block(x, geometry), block.mlp(block.attention(fused)))


def test_chunks_do_not_show(batch_of, small):
    torch.manual_seed(0)
    config, size = small(), CHUNK + 900
    block = FusionBlock(4, 6, config).eval()
    geometry, x = Geometry.of(batch_of(size).levels[0], config), torch.randn(size, 4)
    whole = block(x, geometry)  # with gradients nothing is cut
    assert whole.requires_grad
    with torch.inference_mode():
        torch.testing.assert_close(block(x, geometry), whole.detach(), atol=1e-6, rtol=1e-5)
