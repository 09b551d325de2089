"""Comparing predictions with true labels, from files or arrays, and writing what comes out."""

import csv
import json
import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bushseg.calibration import ConfidenceBins
from bushseg.codes import UNLABELLED, UnknownCodes
from bushseg.errors import DataError
from bushseg.files import atomic_path
from bushseg.label_columns import (
    LabelColumn,
    in_step,
    is_same_column,
    open_labels,
    prediction_column,
    truth_column,
)
from bushseg.metrics import ConfusionMatrix
from bushseg.plots import plot_confusion
from bushseg.progress import SILENT, Progress
from bushseg.scheme import ClassScheme

_SCORES = ("iou", "precision", "recall", "f1")


@dataclass
class Evaluation:
    """How well predictions agree with labels.

    Attributes:
        scheme: The classes compared.
        confusion: Counts and scores; points without a true label aren't in it, labelled points
            without a prediction count as misses.
        num_points: All points, labelled or not.
        num_ignored: Points without a true label.
        confidence: Labelled points by how sure their prediction was; empty where none says.
        unknown_predictions: Predicted codes the scheme doesn't know: they count as no prediction.
        unknown_truth: True codes the scheme doesn't know: they count as no label.
    """

    scheme: ClassScheme
    confusion: ConfusionMatrix
    num_points: int = 0
    num_ignored: int = 0
    confidence: ConfidenceBins = field(default_factory=ConfidenceBins)
    unknown_predictions: UnknownCodes = field(default_factory=UnknownCodes)
    unknown_truth: UnknownCodes = field(default_factory=UnknownCodes)

    def update(
        self,
        predictions: NDArray[np.integer[Any]],
        labels: NDArray[np.integer[Any]],
        confidence: NDArray[np.floating[Any]] | None = None,
    ) -> None:
        """Count more points, as :meth:`ConfusionMatrix.update` takes them.

        Args:
            predictions: Predicted classes, -1 for none, shape (N,).
            labels: True classes, -1 for unlabelled, shape (N,).
            confidence: Probability of the predicted classes, NaN where unknown, shape (N,).
        """
        self.confusion.update(predictions, labels)
        self.num_points += len(labels)
        self.num_ignored += int(np.count_nonzero(labels == UNLABELLED))
        if confidence is not None:
            known = (labels != UNLABELLED) & (predictions != UNLABELLED)
            self.confidence.update(confidence[known], (predictions == labels)[known])

    def as_dict(self) -> dict[str, Any]:
        """Give everything as JSON can hold it; scores that are undefined are None."""
        columns = {name: getattr(self.confusion, name).tolist() for name in _SCORES}
        classes = {
            name: {
                **{score: _or_none(values[label]) for score, values in columns.items()},
                "support": int(self.confusion.support[label]),
            }
            for label, name in enumerate(self.scheme.names)
        }
        return {
            "scheme": self.scheme.name,
            "num_points": self.num_points,
            "num_ignored": self.num_ignored,
            "num_missed": int(self.confusion.missed.sum()),
            "oa": _or_none(self.confusion.oa),
            "miou": _or_none(self.confusion.miou),
            "ece": _or_none(self.confidence.error),
            "mean_confidence": _or_none(self.confidence.mean_confidence),
            "classes": classes,
            "confusion": self.confusion.counts.tolist(),
            "missed": self.confusion.missed.tolist(),
            "unknown_predictions": _unknown_as_dict(self.unknown_predictions),
            "unknown_truth": _unknown_as_dict(self.unknown_truth),
        }

    def write(self, folder: str | Path) -> None:
        """Write metrics.json, per_class.csv, confusion.csv and confusion.png into a folder.

        In confusion.csv rows are true classes, columns predicted ones, the last those without a
        prediction.

        Raises:
            WriteError: The folder can't be created or written to.
        """
        folder = Path(folder)
        result = self.as_dict()
        with atomic_path(folder / "metrics.json") as partial:
            partial.write_text(json.dumps(result, indent=2, allow_nan=False) + "\n", "utf-8")
        scores = [
            [name, *("" if value is None else value for value in row.values())]
            for name, row in result["classes"].items()
        ]
        _write_csv(folder / "per_class.csv", [["class", *_SCORES, "support"], *scores])
        names = self.scheme.names
        counts = [
            [name, *row, missed]
            for name, row, missed in zip(names, result["confusion"], result["missed"], strict=True)
        ]
        _write_csv(folder / "confusion.csv", [["true class", *names, "(none)"], *counts])
        plot_confusion(self.confusion, names, folder / "confusion.png")


def evaluate_arrays(
    predictions: NDArray[np.integer[Any]], labels: NDArray[np.integer[Any]], scheme: ClassScheme
) -> Evaluation:
    """Compare predictions with labels that are in memory.

    Args:
        predictions: Positions in the scheme, shape (N,), any integer dtype, -1 for none.
        labels: The true ones, shape (N,), any integer dtype, -1 for unlabelled.
        scheme: What the positions mean.

    Raises:
        DataError: The shapes differ, or a value is outside -1 .. C-1.
    """
    evaluation = Evaluation(scheme, ConfusionMatrix(scheme.num_classes))
    evaluation.update(predictions, labels)
    return evaluation


def evaluate(
    prediction: str | Path,
    truth: str | Path | None,
    scheme: ClassScheme,
    *,
    prediction_field: str | None = None,
    truth_field: str | None = None,
    truth_scheme: ClassScheme | None = None,
    progress: Progress = SILENT,
) -> Evaluation:
    """Compare a labelled file with the truth, streaming both.

    The column `class_index` holds positions in `scheme`, 255 for none; any other column holds the
    scheme's source codes.

    Args:
        prediction: A labelled scan, or codes alone (`.label`, `.labels`).
        truth: The same points in the same order with their true labels, as a scan or codes alone.
            None where `prediction` holds both.
        scheme: The classes to compare.
        prediction_field: The column of predictions; unless given, `class_index`, else
            `predicted_label`, else the format's label column.
        truth_field: The column of true labels; unless given, the format's label column.
        truth_scheme: What the true codes mean, where that isn't `scheme`: they are translated by
            their `bush` equivalents.
        progress: Told the points done, and what the schemes didn't know.

    Raises:
        ReadError: A file is missing or damaged.
        DataError: A column is missing, the files don't hold the same points, or no point has a
            true label under the scheme.
    """
    evaluation = Evaluation(scheme, ConfusionMatrix(scheme.num_classes))
    with ExitStack() as stack:
        reader = stack.enter_context(open_labels(Path(prediction)))
        predicted = prediction_column(reader, prediction_field, scheme)
        if truth is not None:
            reader = stack.enter_context(open_labels(Path(truth)))
        true = truth_column(reader, truth_field, truth_scheme or scheme)
        if is_same_column(predicted, true):
            raise DataError(
                f"{prediction}: {predicted.name!r} would be compared with itself; expected the "
                "truth in another column or another file: name it"
            )
        progress.start(f"comparing {Path(prediction).name}", reader.info.num_points, "points")
        for predictions, labels, confidence in in_step(predicted, true):
            evaluation.update(predictions, true.scheme.translate(labels, scheme), confidence)
            progress.advance(len(labels))
    evaluation.unknown_predictions, evaluation.unknown_truth = predicted.unknown, true.unknown
    if evaluation.num_ignored == evaluation.num_points:
        raise DataError(
            f"{reader.info.path}: no point has a label under scheme {true.scheme.name!r} in column "
            f"{true.name!r} (unknown codes: {str(true.unknown) or 'none'}); choose another column "
            "or scheme"
        )
    _note_unknown(predicted, "count as no prediction", progress)
    _note_unknown(true, "are ignored", progress)
    return evaluation


def _note_unknown(column: LabelColumn, consequence: str, progress: Progress) -> None:
    """Tell of codes that the scheme doesn't know."""
    if column.unknown.num_points:
        progress.note(
            f"{column.reader.info.path.name}: {column.unknown.num_points:,} points hold codes that "
            f"scheme {column.scheme.name!r} doesn't know and {consequence}: {column.unknown}"
        )


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


def _unknown_as_dict(unknown: UnknownCodes) -> dict[str, Any]:
    return {
        "codes": {str(code): count for code, count in sorted(unknown.codes.items())},
        "invalid": unknown.invalid,
    }


def _write_csv(path: Path, rows: Sequence[Sequence[object]]) -> None:
    with atomic_path(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
