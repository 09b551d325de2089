"""What a training step costs, and what SPF's part in it is.

    python benchmarks/training_step.py [--crops 4] [--crop-points 12288]

One step (forward, backward, update) of BushNet and of RandLA-Net on the same simulated crops; the
time to compute SPF at all levels; and the bytes a cached crop has without SPF and would have with.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from bushseg.batches import EpochBatches
from bushseg.config import NetworkConfig, PrepareConfig, TrainConfig
from bushseg.dataset import Dataset
from bushseg.models.bushnet import BushNet, count_parameters
from bushseg.preparation import prepare
from bushseg.simulation import SimulateConfig, simulate
from bushseg.spf import simple_point_features


def median_seconds(function: Callable[[], object], repeats: int = 5) -> float:
    """Median time of a call, the first not counted."""
    function()
    times = []
    for _ in range(repeats):
        begun = time.perf_counter()
        function()
        times.append(time.perf_counter() - begun)
    return float(np.median(times))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--crops", type=int, default=4)
    parser.add_argument("--crop-points", type=int, default=12288)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        simulate(root / "scans", SimulateConfig(seed=1))
        settings = PrepareConfig(crop_points=options.crop_points, num_crops=options.crops)
        prepare([root / "scans"], root / "prepared", settings)
        dataset = Dataset(root / "prepared")
        file_bytes = np.median([p.stat().st_size for p in root.glob("prepared/crops-*/crop_*")])
        config = TrainConfig(batch_size=options.crops, validation="none")
        tiles, _ = dataset.split(config)
        epoch = EpochBatches(dataset, tiles, dataset.features, config, 0)
        batch, labels = next(iter(epoch.start()))
    num_points = len(labels)
    print(f"{torch.get_num_threads()} threads, {num_points:,} points a step")
    print("| network | parameters | step, s | points/s |\n|---|---|---|---|")
    for name, network_config in (
        ("BushNet", NetworkConfig()),
        ("RandLA-Net", NetworkConfig.randla()),
    ):
        network = BushNet(batch.features.shape[1], dataset.scheme.num_classes, network_config)
        optimizer = torch.optim.Adam(network.parameters(), 0.01)

        def step(network: BushNet = network, optimizer: torch.optim.Adam = optimizer) -> None:
            loss = torch.nn.functional.cross_entropy(network(batch), labels, ignore_index=-1)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()

        seconds = median_seconds(step)
        total = count_parameters(network)["total"]
        print(f"| {name} | {total:,} | {seconds:.2f} | {num_points / seconds:,.0f} |", flush=True)
        if name == "BushNet":
            bushnet = seconds

    def spf() -> None:
        for level in batch.levels:
            simple_point_features(level.xyz, level.normals, level.neighbors)

    seconds = median_seconds(spf)
    spf_bytes = sum(level.neighbors.numel() * 3 * 4 for level in batch.levels) / options.crops
    print(f"\nSPF at all levels: {seconds:.3f} s, {seconds / bushnet:.1%} of a BushNet step")
    print(f"a cached crop: {file_bytes:,.0f} bytes; SPF would add {spf_bytes:,.0f}")


if __name__ == "__main__":
    main()
