"""One measurement of Open3D-ML's RandLA-Net; runs in the peer's virtual environment.

    python benchmarks/open3d_ml_worker.py '{"part": "predict", "points": "scan.npy", ...}'

Started by `open3d_ml.py`, a process each. Knows nothing of bushseg: points come as an (N, 3) float32
array in metres from a nearby origin. Prints one line of JSON: the seconds, and what they were for.
"""

import ctypes
import json
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch


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
    """RandLA-Net of the job's size, random weights, everything else as it comes.

    No features but the coordinates: the least work for it.
    """
    torch.manual_seed(0)
    return ml3d.models.RandLANet(
        num_neighbors=16,
        num_layers=4,
        sub_sampling_ratio=[4, 4, 4, 4],
        num_points=job["crop_points"],
        num_classes=job["num_classes"],
        in_channels=3,
        grid_size=job["voxel_size"],
    )


def cloud(points: np.ndarray, num_classes: int) -> dict[str, Any]:
    """What Open3D-ML takes as data; labels of 1 and up, for 0 is "ignored"."""
    labels = np.random.default_rng(0).integers(1, num_classes + 1, len(points))
    return {"point": points, "feat": None, "label": labels.astype(np.int32)}


def predict(ml3d: Any, job: dict[str, Any], points: np.ndarray) -> dict[str, Any]:
    """Time `run_inference`, from points in memory to labels in memory."""
    model = build_model(ml3d, job)
    seen, preprocessing = [], []
    preprocess = model.preprocess

    def timed_preprocess(*arguments: Any) -> Any:
        begun = time.perf_counter()
        data = preprocess(*arguments)
        preprocessing.append(time.perf_counter() - begun)
        voxels.append(len(data["point"]))
        return data

    voxels: list[int] = []
    model.preprocess = timed_preprocess
    model.register_forward_hook(lambda _, __, scores: seen.append(scores.shape[:2].numel()))
    with tempfile.TemporaryDirectory() as logs:
        pipeline = ml3d.pipelines.SemanticSegmentation(
            model, device="cpu", batch_size=job["batch_size"], main_log_dir=logs
        )
        pipeline.run_inference(cloud(points[:: len(points) // 2000], job["num_classes"]))
        seen.clear(), preprocessing.clear(), voxels.clear()
        data = cloud(points, job["num_classes"])
        begun = time.perf_counter()
        result = pipeline.run_inference(data)
        seconds = time.perf_counter() - begun
    scores = np.asarray(result["predict_scores"], dtype=np.float32)
    if len(scores) != len(points) or not np.isfinite(scores).all():
        raise RuntimeError("Open3D-ML did not label every point")
    return {
        "seconds": seconds,
        "preprocess_seconds": sum(preprocessing),
        "num_preprocess": len(preprocessing),
        "num_voxels": voxels[0],
        "passes": sum(seen) / voxels[0],
        "forward_calls": len(seen),
        "score_std": float(scores.std()),
    }


def prepare(ml3d: Any, job: dict[str, Any], points: np.ndarray) -> dict[str, Any]:
    """Time `preprocess` as for training: grid sub-sampling and a KD-tree, points in memory."""
    model = build_model(ml3d, job)
    model.preprocess(cloud(points[::100], job["num_classes"]), {"split": "training"})
    data = cloud(points, job["num_classes"])
    begun = time.perf_counter()
    prepared = model.preprocess(data, {"split": "training"})
    return {"seconds": time.perf_counter() - begun, "num_voxels": len(prepared["point"])}


def training(ml3d: Any, job: dict[str, Any], points: np.ndarray) -> dict[str, Any]:
    """Time forward, loss, backward and update on one batch that is built beforehand."""
    model = build_model(ml3d, job)
    model.device = torch.device("cpu")
    data = model.preprocess(cloud(points, job["num_classes"]), {"split": "training"})
    attributes = {"split": "training"}
    begun = time.perf_counter()
    crops = [
        {"data": model.transform(data, attributes), "attr": attributes}
        for _ in range(job["batch_size"])
    ]
    transform_seconds = time.perf_counter() - begun
    from open3d._ml3d.torch.dataloaders import DefaultBatcher
    inputs = DefaultBatcher().collate_fn(crops)
    class Loss:
        weighted_CrossEntropyLoss = torch.nn.CrossEntropyLoss()
    optimizer = torch.optim.Adam(model.parameters(), 0.01)
    model.train()

    def step() -> None:
        optimizer.zero_grad()
        loss, _, _ = model.get_loss(Loss, model(inputs["data"]), inputs, model.device)
        loss.backward()
        optimizer.step()

    return {"transform_seconds": transform_seconds, "num_points": inputs["data"]["labels"].numel(), **timed_steps(step, job["steps"])}


def timed_steps(step: Callable[[], None], count: int) -> dict[str, Any]:
    """Median of some steps, the first two not counted."""
    seconds = []
    for _ in range(count + 2):
        begun = time.perf_counter()
        step()
        seconds.append(time.perf_counter() - begun)
    return {"seconds": float(np.median(seconds[2:])), "all": seconds}


def main() -> None:
    job = json.loads(sys.argv[1])
    torch.set_num_threads(job["threads"])
    ml3d = load_open3d_ml()
    points = np.load(job["points"])
    result = {"predict": predict, "prepare": prepare, "training": training}[job["part"]](ml3d, job, points)
    print(json.dumps({**result, "threads": torch.get_num_threads()}))


if __name__ == "__main__":
    main()
