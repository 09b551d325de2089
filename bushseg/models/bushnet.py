"""BushNet (section 3.1, Fig. 1), top to bottom.

An encoder of four layers, each two stacked LMFF + attention blocks in a residual block and then a
decimation to a quarter with neighborhood max-pooling; a decoder of nearest-neighbor up-sampling and
skip concatenation; a head. Widths are RandLA-Net's (Hu et al., 2020), whose layout the paper keeps.
With `NetworkConfig.randla()` and `sampling=random` this is RandLA-Net.

Pure: tensors in, logits out. Neighbors, decimation and interpolation come in with the batch.
"""

from torch import Tensor, nn

from bushseg.config import NetworkConfig
from bushseg.models.batch import Batch, Level
from bushseg.models.chunks import in_chunks
from bushseg.models.kernels import SLOPE
from bushseg.models.layers import Dropout, SharedMLP, gather
from bushseg.models.lmff import FusionBlock, Geometry
from bushseg.models.survivors import pool_survivors


class EncoderLayer(nn.Module):
    """Two fusion blocks in a residual block (RandLA-Net's dilated residual block).

    Args:
        num_in: Width in.
        num_out: Width out, a multiple of 4.
        config: The switches.
    """

    def __init__(self, num_in: int, num_out: int, config: NetworkConfig) -> None:
        super().__init__()
        width = num_out // 4
        self.config = config
        self.width, self.num_out = width, num_out
        self.enter = SharedMLP(num_in, width)
        self.first = FusionBlock(width, width, config)
        self.second = FusionBlock(width, num_out // 2, config)
        self.leave = SharedMLP(num_out // 2, num_out, activation=False)
        self.shortcut = SharedMLP(num_in, num_out, activation=False)

    def forward(self, x: Tensor, level: Level) -> Tensor:
        """(N, num_in) -> (N, num_out)."""
        geometry = Geometry.of(level, self.config, with_moments=self.training)
        entered = in_chunks(self.enter.step(), self.width, x)
        inner = self.second(self.first(entered, geometry), geometry)
        leave, shortcut = self.leave.step(), self.shortcut.step()

        def join(inner: Tensor, x: Tensor) -> Tensor:
            return nn.functional.leaky_relu_(leave(inner).add_(shortcut(x)), SLOPE)

        return in_chunks(join, self.num_out, inner, x)


class DecoderLayer(nn.Module):
    """Nearest-neighbor up-sampling, concatenation with the skip, and a shared MLP.

    The MLP's linear map is applied to both halves before they are joined, and to the coarse half
    before it is repeated: the same sum with a quarter of the arithmetic.

    Args:
        num_coarse: Width from below.
        num_skip: Width of the skip connection.
        num_out: Width out.
    """

    def __init__(self, num_coarse: int, num_skip: int, num_out: int) -> None:
        super().__init__()
        self.num_skip, self.num_out = num_skip, num_out
        self.mlp = SharedMLP(num_skip + num_coarse, num_out)

    def forward(self, coarse: Tensor, skip: Tensor, interpolated: Tensor) -> Tensor:
        """Coarse (M, num_coarse), skip (N, num_skip), interpolated (N,) -> (N, num_out)."""
        finish, weight = self.mlp.split_step()
        of_skip, of_coarse = weight[:, : self.num_skip].T, weight[:, self.num_skip :].T
        from_coarse = in_chunks(lambda rows: rows @ of_coarse, self.num_out, coarse)

        def join(skip: Tensor, interpolated: Tensor) -> Tensor:
            return finish((skip @ of_skip).add_(gather(from_coarse, interpolated)))

        return in_chunks(join, self.num_out, skip, interpolated)


class BushNet(nn.Module):
    """The network.

    Args:
        num_features: Width of the input features.
        num_classes: How many classes.
        config: The switches and widths.
    """

    def __init__(self, num_features: int, num_classes: int, config: NetworkConfig) -> None:
        super().__init__()
        widths = config.widths
        self.stem_width, self.num_classes = config.stem_width, num_classes
        self.stem = SharedMLP(num_features, config.stem_width)
        incoming = (config.stem_width, *widths[:-1])
        self.encoder = nn.ModuleList(
            EncoderLayer(num_in, num_out, config)
            for num_in, num_out in zip(incoming, widths, strict=True)
        )
        self.bottleneck = SharedMLP(widths[-1], widths[-1])
        # Skips, coarse to fine: each layer's decimated features, then the first's undecimated.
        skips = (*reversed(widths[:-1]), widths[0])
        below = (widths[-1], *skips[:-1])
        self.decoder = nn.ModuleList(
            DecoderLayer(num_coarse, num_skip, num_skip)
            for num_coarse, num_skip in zip(below, skips, strict=True)
        )
        first, second = config.head_widths
        self.head = nn.Sequential(
            SharedMLP(widths[0], first),
            SharedMLP(first, second),
            Dropout(config.dropout),
            nn.Linear(second, num_classes),
        )

    def forward(self, batch: Batch) -> Tensor:
        """Class scores of level 0.

        Args:
            batch: Features (N, num_features) and as many levels as the network has layers.

        Returns:
            Logits, (N, num_classes).
        """
        x = in_chunks(self.stem.step(), self.stem_width, batch.features)  # (N, 8)
        skips: list[Tensor] = []
        for layer, level in zip(self.encoder, batch.levels, strict=True):
            x = layer(x, level)  # (N_l, width)
            if not skips:
                skips.append(x)
            x = pool_survivors(x, level)  # (N_{l+1}, width)
            skips.append(x)
        x = skips.pop()
        x = in_chunks(self.bottleneck.step(), x.shape[1], x)
        for layer, level in zip(self.decoder, reversed(batch.levels), strict=True):
            x = layer(x, skips.pop(), level.interpolated)
        return self._classify(x)

    def _classify(self, x: Tensor) -> Tensor:
        """The head, (N, width) -> (N, num_classes)."""
        first, second, dropout, linear = self.head
        assert isinstance(first, SharedMLP)
        assert isinstance(second, SharedMLP)
        widen, narrow = first.step(), second.step()
        return in_chunks(lambda rows: linear(dropout(narrow(widen(rows)))), self.num_classes, x)


def count_parameters(network: nn.Module) -> dict[str, int]:
    """Trainable parameters by top-level module, and their "total"."""
    counts = {
        name: sum(p.numel() for p in module.parameters() if p.requires_grad)
        for name, module in network.named_children()
    }
    return counts | {"total": sum(counts.values())}
