"""One measurement of Open3D-ML's RandLA-Net; runs in the peer's virtual environment.

    python benchmarks/open3d_ml_peer.py '{"part": "predict", "points": "scan.npy", ...}'

Started by `open3d_ml.py`, a process each; knows nothing of bushseg. Points come as an array (N, 3)
float32, metres from a nearby origin. The network gets their coordinates and no other feature, which
is the least work for it. The last line printed is JSON: the seconds, and what they went into.
"""

import ctypes
import json
import sys
import tempfile
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray


def load_open3d_ml() -> Any:
    """Import `open3d.ml.torch`, with libusb from its wheel where the system has none."""
    try:
        ctypes.CDLL("libusb-1.0.so.0", mode=ctypes.RTLD_GLOBAL)
    except OSError:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d.ml.torch

    return open3d.ml.torch


def build_model(ml3d: Any, job: dict[str, Any]) -> Any:
    """RandLA-Net at the job's voxel and crop size, of random weights; all else is its default."""
    torch.manual_seed(0)
    model = ml3d.models.RandLANet(
        num_neighbors=16,
        num_layers=4,
        sub_sampling_ratio=[4, 4, 4, 4],
        num_points=job["crop_points"],
        num_classes=job["num_classes"],
        in_channels=3,
        grid_size=job["voxel_size"],
    )
    model.device = torch.device("cpu")
    return model


def cloud(points: NDArray[np.float32]) -> dict[str, Any]:
    """What Open3D-ML takes as data; label 0 is its "ignored", and votes in a voxel fastest."""
    return {"point": points, "feat": None, "label": np.zeros(len(points), dtype=np.int32)}


def predict(ml3d: Any, job: dict[str, Any], points: NDArray[np.float32]) -> dict[str, Any]:
    """Time `run_inference`, from points in memory to labels in memory."""
    model = build_model(ml3d, job)
    num_seen, num_voxels, preprocess_seconds = [], [], []
    preprocess = model.preprocess

    def timed_preprocess(*arguments: Any) -> dict[str, Any]:
        begun = time.perf_counter()
        data = preprocess(*arguments)
        preprocess_seconds.append(time.perf_counter() - begun)
        num_voxels.append(len(data["point"]))
        return data

    model.preprocess = timed_preprocess
    model.register_forward_hook(lambda *call: num_seen.append(call[2].shape[:2].numel()))
    data = cloud(points)
    warm_up = {name: None if array is None else array[::1000] for name, array in data.items()}
    with tempfile.TemporaryDirectory() as logs:
        pipeline = ml3d.pipelines.SemanticSegmentation(
            model, device="cpu", batch_size=job["batch_size"], main_log_dir=logs
        )
        pipeline.run_inference(warm_up)
        for counts in (num_seen, num_voxels, preprocess_seconds):
            counts.clear()
        begun = time.perf_counter()
        result = pipeline.run_inference(data)
        seconds = time.perf_counter() - begun
    scores = np.asarray(result["predict_scores"], dtype=np.float32)
    if len(scores) != len(points) or not np.isfinite(scores).all():
        raise RuntimeError("not every point has scores")
    return {
        "seconds": seconds,
        "stages": {"preprocess": sum(preprocess_seconds)},
        "num_voxels": num_voxels[0],
        "passes": sum(num_seen) / num_voxels[0],
    }


def prepare(ml3d: Any, job: dict[str, Any], points: NDArray[np.float32]) -> dict[str, Any]:
    """Time `preprocess` as for training: a grid sub-sampling and a KD-tree, points in memory."""
    model = build_model(ml3d, job)
    split = {"split": "training"}
    model.preprocess(cloud(points[::1000]), split)
    data = cloud(points)
    begun = time.perf_counter()
    prepared = model.preprocess(data, split)
    return {"seconds": time.perf_counter() - begun, "num_voxels": len(prepared["point"])}


def training(ml3d: Any, job: dict[str, Any], points: NDArray[np.float32]) -> dict[str, Any]:
    """Time forward, loss, backward and update on one batch of real crops with random labels."""
    from open3d._ml3d.torch.dataloaders import DefaultBatcher

    model = build_model(ml3d, job)
    split = {"split": "training"}
    data = model.preprocess(cloud(points), split)
    begun = time.perf_counter()
    crops = [{"data": model.transform(data, split)} for _ in range(job["batch_size"])]
    batch = DefaultBatcher().collate_fn(crops)
    batch_seconds = time.perf_counter() - begun
    labels = batch["data"]["labels"]
    batch["data"]["labels"] = torch.randint(1, job["num_classes"] + 1, labels.shape)
    loss_module = SimpleNamespace(weighted_CrossEntropyLoss=torch.nn.CrossEntropyLoss())
    optimizer = torch.optim.Adam(model.parameters(), 0.01)
    model.train()
    seconds = []
    for _ in range(job["warm_up_steps"] + job["steps"]):
        begun = time.perf_counter()
        optimizer.zero_grad()
        loss, _, _ = model.get_loss(loss_module, model(batch["data"]), batch, model.device)
        loss.backward()
        optimizer.step()
        seconds.append(time.perf_counter() - begun)
    return {
        "seconds": float(np.median(seconds[job["warm_up_steps"] :])),
        "num_points": labels.numel(),
        "stages": {"making the batch, not counted": batch_seconds},
    }


def main() -> None:
    """Do one job and print what came of it."""
    job = json.loads(sys.argv[1])
    ml3d = load_open3d_ml()
    torch.set_num_threads(job["threads"])
    part = {"predict": predict, "prepare": prepare, "training": training}[job["part"]]
    result = part(ml3d, job, np.load(job["points"]))
    print(json.dumps(result))


if __name__ == "__main__":
    main()
