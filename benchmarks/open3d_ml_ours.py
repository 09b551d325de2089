"""One measurement of bushseg, in a process of its own: the other side of `open3d_ml_peer.py`.

    python benchmarks/open3d_ml_ours.py '{"part": "predict", "scan": "scan.laz", ...}'

Started by `open3d_ml.py`. The last line printed is JSON: the seconds, and what they went into.
"""

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

import bushseg
from bushseg.batches import EpochBatches
from bushseg.checkpoint import ModelCard, build_network, load_model, save_model
from bushseg.config import NetworkConfig, PrepareConfig, TrainConfig
from bushseg.dataset import Dataset
from bushseg.loss import weighted_cross_entropy
from bushseg.models.bushnet import BushNet
from bushseg.models.precision import multiplying_in
from bushseg.runs import find_model

NETWORKS = {"BushNet": NetworkConfig(), "RandLA-Net": NetworkConfig.randla()}


def predict(job: dict[str, Any]) -> dict[str, Any]:
    """Time `predict_file`, from opening the scan to the finished output."""
    model = load_model(job["model"])
    with tempfile.TemporaryDirectory() as folder:
        bushseg.predict_file(job["warm_up_scan"], Path(folder, "warm_up.las"), model)
        begun = time.perf_counter()
        result = bushseg.predict_file(job["scan"], Path(folder, "labelled.las"), model)
        seconds = time.perf_counter() - begun
    return {
        "seconds": seconds,
        "stages": result.stages,
        "num_points": result.num_points,
        "num_voxels": result.num_voxels,
        "passes": result.passes,
    }


def prepare(job: dict[str, Any]) -> dict[str, Any]:
    """Time `prepare`, from opening the scan to the finished data set."""
    config = PrepareConfig(**job["config"])
    with tempfile.TemporaryDirectory() as folder:
        bushseg.prepare([job["warm_up_scan"]], Path(folder, "warm_up"), config)
        begun = time.perf_counter()
        result = bushseg.prepare([job["scan"]], Path(folder, "prepared"), config)
        seconds = time.perf_counter() - begun
    return {"seconds": seconds, "num_voxels": result.num_voxels, "num_crops": result.num_crops}


def training(job: dict[str, Any]) -> dict[str, Any]:
    """Time forward, loss, backward and update on one batch of real crops with random labels."""
    config = TrainConfig(batch_size=job["batch_size"], validation="none")
    with tempfile.TemporaryDirectory() as folder:
        bushseg.prepare([job["scan"]], folder, PrepareConfig(**job["config"]))
        dataset = Dataset(folder)
        tiles, _ = dataset.split(config)
        begun = time.perf_counter()
        epoch = EpochBatches(dataset, tiles, dataset.features, config, 0)
        batch, labels = next(iter(epoch.start()))
        batch_seconds = time.perf_counter() - begun
    torch.manual_seed(0)
    num_classes = dataset.scheme.num_classes
    labels = torch.randint(num_classes, labels.shape)
    weights = torch.ones(num_classes)
    network = BushNet(batch.features.shape[1], num_classes, NETWORKS[job["network"]])
    optimizer = torch.optim.Adam(network.parameters(), 0.01)
    network.train()
    seconds = []
    for _ in range(job["warm_up_steps"] + job["steps"]):
        begun = time.perf_counter()
        with multiplying_in(job.get("precision", "float32")):
            optimizer.zero_grad()
            loss = weighted_cross_entropy(network(batch), labels, weights)
            loss.backward()
            optimizer.step()
        seconds.append(time.perf_counter() - begun)
    return {
        "seconds": float(np.median(seconds[job["warm_up_steps"] :])),
        "num_points": len(labels),
        "stages": {"making the batch, not counted": batch_seconds},
    }


def model_at(voxel_size: float, folder: Path, source: Path | None) -> Path:
    """A model file for scans of this voxel size, from a trained model or of random weights."""
    if source is not None:
        trained = load_model(find_model(source))
        card, network = trained.card, trained.network
        prepare = card.prepare.model_copy(update={"voxel_size": voxel_size})
        card = card.model_copy(update={"prepare": prepare})
    else:
        card = ModelCard(
            scheme=bushseg.load_scheme("bush"),
            features=("intensity", "height"),
            prepare=PrepareConfig(voxel_size=voxel_size),
            network=NetworkConfig(),
            neighbor_distance=(voxel_size, 4 * voxel_size),
        )
        torch.manual_seed(0)
        network = build_network(card)
        for module in network.modules():
            if isinstance(module, nn.BatchNorm1d):
                module.running_mean = torch.randn(module.num_features) * 0.1
                module.running_var = torch.rand(module.num_features) + 0.5
    path = folder / f"model_{voxel_size}.safetensors"
    save_model(path, card, network)
    return path


def main() -> None:
    """Do one job and print what came of it."""
    job = json.loads(sys.argv[1])
    torch.set_num_threads(job["threads"])
    part = {"predict": predict, "prepare": prepare, "training": training}[job["part"]]
    print(json.dumps(part(job)))


if __name__ == "__main__":
    main()
