"""Finds bushes in large point clouds.

    import bushseg

    bushseg.prepare(["scans/"])
    bushseg.train()
    bushseg.predict_file("site.las", "labeled.las")
    labels, probabilities = bushseg.predict(xyz)

Nothing heavy is imported before it is used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bushseg.checkpoint import load_model
    from bushseg.errors import BushsegError
    from bushseg.evaluation import evaluate, evaluate_arrays
    from bushseg.folder_prediction import predict_folder
    from bushseg.info import describe
    from bushseg.io import open_scan, read
    from bushseg.labels import load_scheme
    from bushseg.points import PointCloud
    from bushseg.prediction import predict, predict_file
    from bushseg.preparation import prepare
    from bushseg.simulation import simulate
    from bushseg.training import train
    from bushseg.verification import verify

__all__ = [
    "BushsegError",
    "PointCloud",
    "describe",
    "evaluate",
    "evaluate_arrays",
    "load_model",
    "load_scheme",
    "open_scan",
    "predict",
    "predict_file",
    "predict_folder",
    "prepare",
    "read",
    "simulate",
    "train",
    "verify",
]

_HOMES = {
    "BushsegError": "errors",
    "PointCloud": "points",
    "describe": "info",
    "evaluate": "evaluation",
    "evaluate_arrays": "evaluation",
    "load_model": "checkpoint",
    "load_scheme": "labels",
    "open_scan": "io",
    "predict": "prediction",
    "predict_file": "prediction",
    "predict_folder": "folder_prediction",
    "prepare": "preparation",
    "read": "io",
    "simulate": "simulation",
    "train": "training",
    "verify": "verification",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'bushseg' has no attribute {name!r}")
    value = getattr(import_module(f"bushseg.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
