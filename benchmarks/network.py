"""How fast the network is, beside how fast this machine could be.

    python benchmarks/network.py [SCAN] [--voxel-size 0.25] [--model runs/NAME] [--repeats 5]

The forward pass over one tile that holds the whole scan (a simulated site where none is given),
against the machine's own rate of multiplying matrices in float32 and the network's count of
operations. Where a model is given, also how many labels bfloat16 changes, and its mIoU where the
scan has labels. Without one the weights are random: time does not depend on them.
"""

import argparse
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch
from open3d_ml_ours import model_at
from training_step import median_seconds

from bushseg import io
from bushseg.checkpoint import Model, load_model
from bushseg.config import NetworkConfig, Precision
from bushseg.inference import feature_matrix, tile_logits
from bushseg.metrics import ConfusionMatrix
from bushseg.models.batch import Batch
from bushseg.models.bushnet import BushNet
from bushseg.models.lmff import POSITION_WIDTH, SPF_WIDTH
from bushseg.models.precision import has_bfloat16_units
from bushseg.parallel import num_workers
from bushseg.runs import find_model
from bushseg.scan import read_voxels
from bushseg.simulation import SimulateConfig, simulate
from bushseg.tile_data import NetworkTile, cut_tile
from bushseg.tiling import Tiling


def operations(network: BushNet, batch: Batch, config: NetworkConfig) -> float:
    """Multiplications and additions of the linear maps, each feature mapped before it is gathered.

    What exponentials, activations and sums over neighbors cost is not in it.
    """
    sizes = [len(level.xyz) for level in batch.levels] + [len(batch.levels[-1].decimated)]
    k = batch.levels[0].neighbors.shape[1]
    columns = POSITION_WIDTH[config.position] * config.spo + SPF_WIDTH * config.spf
    num_lifts = config.spo + config.spf
    rows = [("stem.", sizes[0]), ("bottleneck.", sizes[-1]), ("head.", sizes[0])]
    rows += [(f"encoder.{level}.", sizes[level]) for level in range(len(batch.levels))]
    total = 0.0
    for name, weight in network.named_parameters():
        if weight.ndim != 2 or "lifts" in name or "score" in name or name.startswith("decoder"):
            continue
        size = next(size for prefix, size in rows if name.startswith(prefix))
        total += size * weight.numel()
    for level, width in enumerate(config.widths):
        w = width // 4
        fused = w * (1 + num_lifts)
        pairs = k * (columns * w + (fused - w) * fused)
        total += 2 * sizes[level] * (pairs + w * fused)
    for number, layer in enumerate(network.decoder):
        coarse = len(config.widths) - number
        out, taken = layer.mlp.linear.weight.shape
        total += sizes[coarse - 1] * out * layer.num_skip
        total += sizes[coarse] * out * (taken - layer.num_skip)
    return 2 * total


def matmul_rate(repeats: int) -> float:
    """Operations a second of a large float32 product, on all cores."""
    size = 4096
    a, b = torch.rand(size, size), torch.rand(size, size)
    return 2 * size**3 / median_seconds(lambda: a @ b, repeats)


@contextmanager
def scan_path(given: Path | None) -> Iterator[Path]:
    """The scan, or a simulated one."""
    if given is not None:
        yield given
        return
    with tempfile.TemporaryDirectory() as folder:
        simulate(folder, SimulateConfig(seed=1))
        yield sorted(Path(folder).iterdir())[0]


def read_tile(path: Path, model: Model) -> NetworkTile:
    """The whole scan as one tile."""
    with io.open_scan(path) as reader:
        scan = read_voxels(reader, model.card.prepare.voxel_size, model.card.scheme)
    tiling = Tiling(scan.voxels.keys, len(scan.voxels), 0)
    return cut_tile(scan, tiling, tiling.tiles[0], model.card.prepare)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("scan", type=Path, nargs="?")
    parser.add_argument("--voxel-size", type=float, default=0.25)
    parser.add_argument("--model", type=Path)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, scan_path(options.scan) as path:
        if options.model is not None:
            model = load_model(find_model(options.model))
        else:
            model = load_model(model_at(options.voxel_size, Path(folder), None))
        tile = read_tile(path, model)
    rate = matmul_rate(options.repeats)
    card, size = model.card, model.card.prepare.voxel_size
    print(
        f"{num_workers()} cores; {len(tile):,} voxels of {size} m; a float32 product of 4096 x "
        f"4096 matrices: {rate / 1e9:.0f} GFLOP/s\n"
    )
    print("| network | products in | MFLOP/voxel | roofline, voxels/s | voxels/s | share |")
    print("|---|---|---:|---:|---:|---:|")
    batch = Batch.from_numpy(
        feature_matrix(tile.features, card.features, len(tile)),
        tile.xyz,
        tile.normals,
        tile.pyramid,
        size,
    )
    precisions: list[Precision] = ["float32"]
    if has_bfloat16_units():
        precisions.append("bfloat16")
    for name, config in (("BushNet", card.network), ("RandLA-Net", NetworkConfig.randla())):
        network = model.network
        if name != "BushNet":
            network = BushNet(batch.features.shape[1], card.scheme.num_classes, config).eval()
        flops = operations(network, batch, config) / len(tile)
        for precision in precisions:

            def forward(network: BushNet = network, precision: Precision = precision) -> object:
                return tile_logits(network, tile, card.features, size, precision)

            speed = len(tile) / median_seconds(forward, options.repeats)
            print(
                f"| {name} | {precision} | {flops / 1e6:.3f} | {rate / flops:,.0f} | {speed:,.0f} "
                f"| {speed * flops / rate:.0%} |",
                flush=True,
            )
    if options.model is not None and len(precisions) > 1:
        exact, rounded = (
            tile_logits(model.network, tile, card.features, size, precision).argmax(axis=1)
            for precision in precisions
        )
        print(f"\nbfloat16 changes {(exact != rounded).mean():.3%} of the labels.")
        truth = tile.labels[tile.is_core]
        if (truth >= 0).any():
            for precision, labels in zip(precisions, (exact, rounded), strict=True):
                confusion = ConfusionMatrix(card.scheme.num_classes)
                confusion.update(labels, truth)
                print(f"mIoU with products in {precision}: {confusion.miou:.2%}")


if __name__ == "__main__":
    main()
