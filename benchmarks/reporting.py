"""All that is asked of a labeler, printed: the worst figures first."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from judging import BUSH_LABEL, NAMES, Judged, Labeler, read_scan
from objects import LOW, held_out_objects, judge_objects, score_objects
from real_scans import GROUPS, SOURCES, Source
from report_tables import print_calibration, print_scores, print_shares, print_verdicts
from scoring import (
    BANDS,
    bush_by_band,
    class_confusion,
    group_confidence,
    group_confusion,
    reliability,
)
from tables import print_table

from bushseg.errors import DataError
from bushseg.io import find_scans

MAX_POINTS = 300_000
"""Of a larger scan so many points are judged, drawn at random."""

COLUMNS = {"range": "m", "density": "points in 0.5 m cube", "height": "m"}
"""What bush on simulated scans is split by, and its unit."""


@dataclass
class Report:
    """Figures of several labelers, gathered first and printed together.

    Attributes:
        labelers: Who is judged; their names head the columns.
        summary: What is measured, to one figure a labeler; all of them good when high.
    """

    labelers: Sequence[Labeler]
    summary: dict[str, list[float]] = field(default_factory=dict)

    def note(self, measure: str, value: float) -> None:
        """Add a labeler's figure to the summary; labelers come in their order."""
        self.summary.setdefault(measure, []).append(value)

    def print_summary(self) -> None:
        """Print the summary, what the first labeler is worst at first."""
        rows = sorted(self.summary.items(), key=lambda item: np.nan_to_num(item[1][0], nan=2.0))
        header = ["measure", *(labeler.name for labeler in self.labelers)]
        print_table("Summary, the worst first", header, [[name, *values] for name, values in rows])

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """The summary by labeler and measure; None where a figure is undefined."""
        return {
            labeler.name: {
                measure: None if np.isnan(values[number]) else values[number]
                for measure, values in self.summary.items()
            }
            for number, labeler in enumerate(self.labelers)
        }

    def judge_source(self, source: Source, data: Path) -> None:
        """Judge one collection of real scans."""
        for labeler, judged in self._judge(source.scans(data)):
            confusion = group_confusion(judged, source)
            for group, iou in zip(GROUPS, confusion.iou.tolist(), strict=True):
                if confusion.support[GROUPS.index(group)]:
                    self.note(f"{source.name}: IoU of {group}", iou)
            print_scores(f"{source.name}, {labeler.name}: by group", GROUPS, confusion)
            right, confidence = group_confidence(judged, source)
            ece = reliability(confidence, right).error
            print(f"\nExpected calibration error of the groups' probability: {ece:.3f}")
            rows = [
                (name, judged.predictions[np.isin(judged.codes, _codes(source.names, name))])
                for name in dict.fromkeys(source.names.values())
            ]
            rows = [row for row in rows if len(row[1])]
            print_shares(f"{source.name}, {labeler.name}: true class, and what it is called", rows)
            plants = np.isin(judged.codes, _codes(source.groups, "vegetation"))
            rows = [
                (str(band), judged.predictions[plants & band.mask(judged.columns["height"])])
                for band in BANDS["height"]
            ]
            print_shares(f"{source.name}, {labeler.name}: vegetation by height above ground", rows)

    def judge_objects(self, data: Path) -> None:
        """Judge the held-out single objects."""
        paths = held_out_objects(data)
        for labeler in self.labelers if paths else ():
            alone = judge_objects(labeler, paths, grounded=False)
            grounded = judge_objects(labeler, paths, grounded=True)
            low = [verdict for verdict in grounded if verdict.height <= LOW]
            for where, verdicts in (
                ("", alone),
                (" (on made-up ground)", grounded),
                (f" (on made-up ground, up to {LOW:g} m)", low),
            ):
                scores = score_objects(verdicts)
                self.note(f"vle{where}: bush IoU", scores.bush_iou)
                self.note(f"vle{where}: tree IoU", scores.tree_iou)
                self.note(f"vle{where}: bushes and hedges by majority", scores.bushes_right)
                self.note(f"vle{where}: trees by majority", scores.trees_right)
            print_verdicts(labeler.name, alone, grounded)

    def judge_simulated(self, folders: Sequence[Path]) -> None:
        """Judge simulated scans, whose labels are exact; those of each folder are a row."""
        found: list[list[Judged]] = [[] for _ in self.labelers]
        for folder in folders:
            for parts, (_, judged) in zip(found, self._judge(find_scans([folder])), strict=True):
                parts.append(judged)
        for parts, labeler in zip(found, self.labelers, strict=True):
            rows = []
            for folder, judged in zip(folders, parts, strict=True):
                confusion = class_confusion(judged)
                rows.append([folder.name, *confusion.iou.tolist(), confusion.miou])
                self.note(f"{folder.name}: IoU of bush", float(confusion.iou[BUSH_LABEL]))
            print_table(f"Simulated, {labeler.name}: IoU", ["scans", *NAMES, "mean"], rows)
            judged = Judged.joined(parts)
            confusion = class_confusion(judged)
            for name, iou in zip(NAMES, confusion.iou.tolist(), strict=True):
                self.note(f"all simulated: IoU of {name}", iou)
            print_scores(f"Simulated, {labeler.name}: all, by class", NAMES, confusion)
            for column, unit in COLUMNS.items():
                print_table(
                    f"Simulated, {labeler.name}: bush by {column}",
                    [f"{column}, {unit}", "bush points", "precision", "recall", "IoU"],
                    bush_by_band(judged, column),
                )
            print_calibration(f"Simulated, {labeler.name}", judged)

    def _judge(self, paths: Sequence[Path]) -> Iterable[tuple[Labeler, Judged]]:
        """Read each scan once, and show it to every labeler."""
        parts: list[list[Judged]] = [[] for _ in self.labelers]
        for path in paths:
            scan = read_scan(path)
            for found, labeler in zip(parts, self.labelers, strict=True):
                found.append(Judged.of(labeler, scan).thinned(MAX_POINTS))
        for found, labeler in zip(parts, self.labelers, strict=True):
            if found:
                yield labeler, Judged.joined(found)


def report(
    labelers: Sequence[Labeler], data: Path | None, simulated: Sequence[Path], only: Sequence[str]
) -> Report:
    """Judge labelers on everything, or on what `only` names, and print it.

    Args:
        labelers: Who is judged.
        data: Folder of the real scans; None: none.
        simulated: Simulated scans or their folders.
        only: Names of real sources, "vle" or "simulated"; everything if empty.

    Raises:
        DataError: Nothing was found to judge by.
    """
    result = Report(labelers)
    if data is not None:
        for source in SOURCES.values():
            if not only or source.name in only:
                result.judge_source(source, data)
        if not only or "vle" in only:
            result.judge_objects(data)
    if simulated and (not only or "simulated" in only):
        result.judge_simulated(simulated)
    if not result.summary:
        raise DataError(f"{data}: no scan to judge by; expected frames/, ign/, odm/ or vle/ in it")
    result.print_summary()
    return result


def _codes(names: Mapping[int, str], name: str) -> list[int]:
    """The codes that mean something."""
    return [code for code, own in names.items() if own == name]
