"""How a neighborhood becomes one feature: MAM (section 3.4) and the alternatives of Table 4.

Each takes (N, K, C), the K neighbors' features after LMFF, and gives (N, C); the shared MLP that
follows belongs to the caller. Pooling is over a point's own neighborhood alone, never over the
crop, so a prediction doesn't depend on what else was in the tile.
"""

import torch
from torch import Tensor, nn


class AttentivePooling(nn.Module):
    """RandLA-Net's: softmax scores over the neighbors from a linear map, then their sum."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.score = nn.Linear(width, width, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(N, K, C) -> (N, C)."""
        return (torch.softmax(self.score(x), dim=1) * x).sum(dim=1)

    @property
    def scores(self) -> nn.Linear:
        """The linear map that gives the scores."""
        return self.score

    def combine(self, pooled: Tensor, mean: Tensor) -> Tensor:  # noqa: ARG002 - it has no gate
        """What `forward` gives, from the weighted sum and the mean over the neighbors, (N, C)."""
        return pooled


class ChannelGate(nn.Module):
    """A weight for each channel from the neighborhood's mean, eq. 10 and 11.

    Global average pooling over the K neighbors keeps every channel; a 1-D convolution of kernel 3
    runs across channels (so 3 weights in all); delta is a sigmoid.
    """

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(3).uniform_(-(3**-0.5), 3**-0.5))

    def forward(self, x: Tensor) -> Tensor:
        """(N, K, C) -> (N, C) in (0, 1)."""
        return self.of_mean(x.mean(dim=1))

    def of_mean(self, mean: Tensor) -> Tensor:
        """The same from g(x) of eq. 10, the mean over the neighbors, (N, C)."""
        # As one product with a banded matrix: its three diagonals hold the three weights, and what
        # lies beyond the first and last channel counts as zero.
        left, middle, right = self.weight.unbind()
        one = torch.ones(mean.shape[1], dtype=mean.dtype, device=mean.device)
        band = (
            torch.diag(left * one[1:], 1)
            + torch.diag(middle * one)
            + torch.diag(right * one[1:], -1)
        )
        return torch.sigmoid(mean @ band)  # eq. 11


class MultiChannelAttention(nn.Module):
    """MAM: attention over the K neighbors, and a gate on each channel of their sum.

    The gate is the same for all K neighbors, so weighting the neighbors and then summing equals
    summing and then weighting: the product with w is done once, not K times. The scores are taken
    from the ungated features; the paper's Fig. 5 leaves that open.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.gate = ChannelGate()
        self.pool = AttentivePooling(width)

    def forward(self, x: Tensor) -> Tensor:
        """(N, K, C) -> (N, C)."""
        return self.combine(self.pool(x), x.mean(dim=1))

    @property
    def scores(self) -> nn.Linear:
        """The linear map that gives the scores."""
        return self.pool.score

    def combine(self, pooled: Tensor, mean: Tensor) -> Tensor:
        """What `forward` gives, from the weighted sum and the mean over the neighbors, (N, C)."""
        return self.gate.of_mean(mean) * pooled


class EfficientChannelAttention(nn.Module):
    """ECA-Net's gate alone; the neighbors are averaged."""

    def __init__(self, width: int) -> None:  # noqa: ARG002 - its three weights fit any width
        super().__init__()
        self.gate = ChannelGate()

    def forward(self, x: Tensor) -> Tensor:
        """(N, K, C) -> (N, C)."""
        return self.gate(x) * x.mean(dim=1)


class SqueezeExcitation(nn.Module):
    """SE: the gate is a two-layer bottleneck of a quarter of the width; neighbors are averaged."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.squeeze = nn.Linear(width, max(1, width // 4))
        self.excite = nn.Linear(max(1, width // 4), width)

    def forward(self, x: Tensor) -> Tensor:
        """(N, K, C) -> (N, C)."""
        pooled = x.mean(dim=1)
        return torch.sigmoid(self.excite(torch.relu(self.squeeze(pooled)))) * pooled


class NonLocalAttention(nn.Module):
    """Non-local: every neighbor attends to every other (embedded Gaussian, residual), then mean."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.inner = max(1, width // 2)
        self.embed = nn.Linear(width, 3 * self.inner, bias=False)
        self.out = nn.Linear(self.inner, width)

    def forward(self, x: Tensor) -> Tensor:
        """(N, K, C) -> (N, C)."""
        query, key, value = self.embed(x).split(self.inner, dim=2)
        scores = torch.softmax(query @ key.transpose(1, 2) * self.inner**-0.5, dim=2)  # (N, K, K)
        return (x + self.out(scores @ value)).mean(dim=1)


class AxialAttention(nn.Module):
    """Axial: attention along the neighbors, then along the channels, each residual; then mean."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.neighbors = NonLocalAttention(width)
        self.scale = nn.Parameter(torch.ones(2))

    def forward(self, x: Tensor) -> Tensor:
        """(N, K, C) -> (N, C)."""
        along_neighbors = self.neighbors(x)
        # The neighborhood's channels attend to each other by how they vary over the K neighbors.
        centered = x - x.mean(dim=1, keepdim=True)
        similarity = centered.transpose(1, 2) @ centered / x.shape[1]  # (N, C, C)
        weights = torch.softmax(self.scale[0] * similarity, dim=2)
        along_channels = (weights @ along_neighbors[:, :, None])[:, :, 0]
        return along_neighbors + self.scale[1] * along_channels


ATTENTION: dict[str, type[nn.Module]] = {
    "mam": MultiChannelAttention,
    "randla": AttentivePooling,
    "eca": EfficientChannelAttention,
    "se": SqueezeExcitation,
    "nonlocal": NonLocalAttention,
    "axial": AxialAttention,
}
"""The attention switch."""
