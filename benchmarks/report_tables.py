"""The tables of a report: scores by class, what is called what, single objects, calibration."""

from collections.abc import Sequence

import numpy as np
from judging import BUSH, BUSH_LABEL, NAMES, Judged
from numpy.typing import NDArray
from objects import Verdict
from scoring import reliability, shares
from tables import print_table

from bushseg.metrics import ConfusionMatrix


def print_scores(title: str, names: Sequence[str], confusion: ConfusionMatrix) -> None:
    """One row a class: its points, IoU, precision and recall."""
    columns = (confusion.support, confusion.iou, confusion.precision, confusion.recall)
    rows = zip(names, *(column.tolist() for column in columns), strict=True)
    print_table(title, ["class", "points", "IoU", "precision", "recall"], rows)


def print_shares(title: str, rows: Sequence[tuple[str, NDArray[np.int16]]]) -> None:
    """One row a set of predictions: how many there are, and the share of each class."""
    print_table(
        title,
        ["", "points", *NAMES],
        [[name, len(predictions), *shares(predictions).tolist()] for name, predictions in rows],
    )


def print_verdicts(name: str, alone: Sequence[Verdict], grounded: Sequence[Verdict]) -> None:
    """One row an object: how much of it is called bush, and what it is by majority."""
    rows = [
        [one.name, one.truth or "-", one.height, int(one.counts.sum())]
        + [value for verdict in (one, two) for value in (verdict.share, verdict.majority)]
        for one, two in zip(alone, grounded, strict=True)
    ]
    rows.sort(key=lambda row: (str(row[1]), str(row[0])))
    print_table(
        f"vle, {name}: held-out objects, each by itself",
        [
            "object",
            "truth",
            "height, m",
            "points",
            "bush",
            "majority",
            "bush, on ground",
            "majority",
        ],
        rows,
    )


def print_calibration(title: str, judged: Judged) -> None:
    """ECE of the confidence and of each class's probability, and the reliability of bush."""
    labels = BUSH.encode(judged.codes).labels
    known = labels >= 0
    labels, probabilities = labels[known], judged.probabilities[known]
    top = reliability(probabilities.max(axis=1), probabilities.argmax(axis=1) == labels)
    classes = [reliability(probabilities[:, c], labels == c) for c in range(len(NAMES))]
    rows = [["confidence", top.error], *zip(NAMES, (one.error for one in classes), strict=True)]
    print_table(f"{title}: expected calibration error", ["probability of", "ECE"], rows)
    bush = classes[BUSH_LABEL]
    print_table(
        f"{title}: reliability of the bush probability",
        ["mean probability", "points", "are bush"],
        [
            [said / count, int(count), right / count]
            for said, count, right in zip(
                bush.confidence.tolist(), bush.counts.tolist(), bush.correct.tolist(), strict=True
            )
            if count
        ],
    )
