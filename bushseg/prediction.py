"""A scan in, a labelled scan out; or points in, labels out."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bushseg.checkpoint import Model
from bushseg.config import PredictConfig
from bushseg.errors import DataError
from bushseg.file_labelling import label_file
from bushseg.io.kept import KeptReader
from bushseg.io.memory import MemoryReader
from bushseg.labeler import label_tiles
from bushseg.model_choice import Choice, candidates, choose
from bushseg.points import PointCloud
from bushseg.prediction_result import PredictResult
from bushseg.progress import SILENT, Progress
from bushseg.scan import mask_no_returns, read_voxels
from bushseg.schedulers import opened


def predict_file(
    scan: str | Path,
    output: str | Path,
    model: Choice = None,
    config: PredictConfig | None = None,
    *,
    overwrite: bool = False,
    progress: Progress = SILENT,
) -> PredictResult:
    """Label a scan and write it with everything it had.

    The output's suffix decides its format. LAS and LAZ get ASPRS codes as classification, and every
    format that has room for them the columns `class_index` (index into the model's classes, 255 for
    a point without a label), `confidence` and, where the model knows bush, `bush_probability`.

    Args:
        scan: The scan, never touched.
        output: The file to write, whole or not at all.
        model: A model; a bundled model's name, or "default" for whichever of them suits the scan; a
            model file, a run's folder or its name in `runs/`. None takes the newest run's best
            model if there is one, else as "default". What
            :func:`bushseg.model_choice.candidates` found of these is taken as well.
        config: Settings; None takes the defaults.
        overwrite: Whether an existing output may be replaced.
        progress: Told of points read, voxels labelled and points written.

    Returns:
        What was done.

    Raises:
        BushsegError: The scan can't be read, the model doesn't fit, or the output can't be written.
    """
    config = config or PredictConfig()
    with opened(config.workers, config.scheduler, insecure=config.insecure_scheduler) as scheduler:
        return label_file(
            scan, output, model, config, scheduler, overwrite=overwrite, progress=progress
        )


def predict(
    points: PointCloud | ArrayLike,
    model: Model | str | Path | None = None,
    config: PredictConfig | None = None,
    *,
    attributes: Mapping[str, NDArray[Any]] | None = None,
    sensor: ArrayLike | None = None,
) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
    """Label points that are already in memory, such as a robot's frame.

    Args:
        points: A cloud, or coordinates in metres, shape (N, 3).
        model: A model (load it once and keep it), or what :func:`predict_file` takes.
        config: Settings; None takes the defaults.
        attributes: With bare coordinates: further columns such as "intensity" or "red".
        sensor: Where the sensor stood, shape (3,), if known; normals are oriented to it. In a frame
            whose sensor is the origin, points at (0, 0, 0) are pulses that did not return.

    Returns:
        Class indices, shape (N,), int16, -1 for points that are not finite or did not return; and
        the probability of each class, shape (N, C), float32, zero there.

    Raises:
        DataError: There are no finite points, or the model needs features they lack.
    """
    known = candidates(model)
    cloud = points if isinstance(points, PointCloud) else _cloud(points, attributes or {})
    reader = MemoryReader(cloud, sensor)
    model = choose(known, KeptReader(reader))[0].load()
    scan = read_voxels(reader, model.card.prepare.voxel_size)
    # One row more: what a point without a voxel finds at index -1.
    stitched = np.zeros((len(scan.voxels) + 1, model.card.scheme.num_classes), dtype=np.float32)
    for tile in label_tiles(model, scan, config or PredictConfig()):
        stitched[tile.indices] = tile.probabilities
    found = scan.voxels.find(scan.voxels.grid.keys(mask_no_returns(cloud.xyz, reader)))
    labels = np.append(stitched[:-1].argmax(axis=1), -1).astype(np.int16)
    return labels[found], stitched[found]


def _cloud(points: ArrayLike, attributes: Mapping[str, NDArray[Any]]) -> PointCloud:
    xyz = np.asarray(points, dtype=np.float64)
    if xyz.ndim != 2 or xyz.shape[1] != 3 or not len(xyz):
        raise DataError(f"the points have shape {xyz.shape}; expected (N, 3) with N >= 1")
    return PointCloud(xyz, {name: np.asarray(column) for name, column in attributes.items()})
