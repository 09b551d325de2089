"""The second pass over a scan: every point finds its voxel and is written with all it had."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg import io
from bushseg.config import PredictConfig
from bushseg.errors import ReadError
from bushseg.io.kept import KeptReader
from bushseg.labels import describe_legacy_loss, fit_legacy
from bushseg.progress import Progress
from bushseg.scan import mask_no_returns
from bushseg.scheme import ClassScheme
from bushseg.stages import Stages
from bushseg.stitch import PointPredictions, Stitcher

LAS_SUFFIXES = (".las", ".laz")


def write_labeled(
    kept: KeptReader,
    path: Path,
    suffix: str,
    stitcher: Stitcher,
    scheme: ClassScheme,
    config: PredictConfig,
    progress: Progress,
    stages: Stages,
) -> tuple[NDArray[np.int64], str | None]:
    """Write a scan with its labels.

    Args:
        kept: The scan, read once before.
        path: The file to write.
        suffix: The suffix of the output's final name, which decides its format.
        stitcher: Has the predictions of all voxels.
        scheme: The model's classes.
        config: Which codes LAS gets.
        progress: Told of the points written.
        stages: Told of the time that reading and looking up take; what is left is the caller's.

    Returns:
        Points written, unlabelled first, then per class; and a warning of classes whose codes the
        output can't hold.

    Raises:
        ReadError: The scan isn't what it was.
        WriteError: The output can't be written.
    """
    info = kept.info
    as_las = suffix in LAS_SUFFIXES
    counts = np.zeros(scheme.num_classes + 1, dtype=np.int64)
    added: dict[str, np.dtype[Any]] = {
        "class_index": np.dtype(np.uint8),
        "confidence": np.dtype(np.float32),
    }
    if scheme.bush_index is not None:
        added["bush_probability"] = np.dtype(np.float32)
    with io.create(path, suffix, kept.source, added) as writer:
        for chunk in stages.each("read", kept.chunks()):
            with stages.timed("look up"):
                predicted = stitcher.at(mask_no_returns(chunk.xyz, kept))
                counts += np.bincount(predicted.labels + 1, minlength=len(counts))
                codes: NDArray[Any] | None = None
                if not as_las:
                    codes = scheme.decode(predicted.labels)
                elif not config.keep_classification:
                    codes = scheme.to_asprs(predicted.labels, config.asprs)
                    codes = fit_legacy(codes) if writer.has_legacy_codes else codes
                columns = _columns(predicted, scheme.decode_indices(predicted.labels))
            writer.write(chunk, columns, codes)
            progress.advance(len(chunk))
    if counts.sum() != info.num_points:
        raise ReadError(
            info.path,
            f"{counts.sum():,} points on the second pass",
            f"{info.num_points:,}; leave the file alone while it is being labelled",
        )
    lost = None
    if as_las and writer.has_legacy_codes and not config.keep_classification:
        lost = describe_legacy_loss(scheme, counts[1:], config.asprs)
    return counts, lost


def _columns(
    predicted: PointPredictions, class_index: NDArray[np.uint8]
) -> dict[str, NDArray[Any]]:
    """The columns added to an output."""
    columns: dict[str, NDArray[Any]] = {
        "class_index": class_index,
        "confidence": predicted.confidence,
    }
    if predicted.bush_probability is not None:
        columns["bush_probability"] = predicted.bush_probability
    return columns
