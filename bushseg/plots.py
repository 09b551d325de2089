"""Pictures of how well a model does: the confusion matrix, and training's curves.

Figures are made without pyplot, so nothing global is touched and no display is needed.
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bushseg.files import atomic_path
from bushseg.metrics import ConfusionMatrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DPI = 150
_DARK_CELL = 0.55  # the share from which white text reads better than black


def plot_confusion(confusion: ConfusionMatrix, names: Sequence[str], path: str | Path) -> None:
    """Draw a confusion matrix as an image: each row in per cent of its true class.

    Rows without labels stay grey. Points without a prediction, where there are any, get a column
    of their own.

    Args:
        confusion: The counts.
        names: The classes' names, C of them.
        path: The image to write; its suffix chooses the format.

    Raises:
        WriteError: The folder can't be written to.
    """
    from matplotlib.figure import Figure

    counts, columns = confusion.counts, list(names)
    if confusion.missed.any():
        counts = np.column_stack([counts, confusion.missed])
        columns.append("(none)")
    support = confusion.support
    shares = np.divide(
        counts, support[:, None], out=np.full(counts.shape, np.nan), where=support[:, None] > 0
    )

    size = 0.55 * len(columns) + 3.6, 0.55 * len(names) + 1.8
    figure = Figure(figsize=size, layout="constrained", dpi=_DPI)
    axes = figure.subplots()
    axes.set_facecolor("#e4e4e4")
    image = axes.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    axes.set_xticks(range(len(columns)), columns, rotation=45, ha="right", rotation_mode="anchor")
    rows = [f"{name}  ({_short(count)})" for name, count in zip(names, support, strict=True)]
    axes.set_yticks(range(len(names)), rows)
    axes.set_xlabel("predicted")
    axes.set_ylabel("true (points)")
    axes.set_title(f"OA {_percent(confusion.oa)}   mIoU {_percent(confusion.miou)}")
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    for (row, column), share in np.ndenumerate(shares):
        if share >= 0.0005:
            text = f"{100 * share:.0f}" if share >= 0.0995 else f"{100 * share:.1f}"
            color = "white" if share > _DARK_CELL else "black"
            axes.text(column, row, text, ha="center", va="center", fontsize=8, color=color)
    bar = figure.colorbar(image, ax=axes, shrink=0.7, ticks=[0, 0.25, 0.5, 0.75, 1])
    bar.ax.set_yticklabels(["0", "25", "50", "75", "100 %"])
    bar.outline.set_visible(False)
    _save(figure, path)


def plot_curves(history: Sequence[Mapping[str, float]], path: str | Path) -> None:
    """Draw how training went, epoch by epoch, in three panels.

    A column is drawn by the words in its name: `loss` (as in `train_loss`) in the first panel,
    `miou` and `oa` (`train_miou`, `validation_oa`) in the second, `iou` and a class (`iou_bush`) in
    the third. Others, such as the learning rate, aren't drawn. Scores are fractions; epochs in
    which a column is missing or NaN are passed over.

    Args:
        history: One mapping an epoch, its number under `epoch`, else they are counted from 1.
        path: The image to write; its suffix chooses the format.

    Raises:
        WriteError: The folder can't be written to.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16, 4.6), layout="constrained", dpi=_DPI)
    loss, scores, classes = figure.subplots(1, 3)
    _draw_lines(loss, "Loss", _series(history, {"loss"}))
    _draw_lines(scores, "mIoU and overall accuracy, %", _series(history, {"miou", "oa"}, 100))
    per_class = {
        re.sub(r"^.*?iou[\W_]*", "", name, flags=re.IGNORECASE) or name: points
        for name, points in _series(history, {"iou"}, 100).items()
    }
    _draw_lines(classes, "IoU by class, %", per_class, legend_beside=True)
    for axes in (scores, classes):
        axes.set_ylim(0, 100)
    loss.set_ylim(bottom=0)
    _save(figure, path)


def _series(
    history: Sequence[Mapping[str, float]], words: set[str], factor: float = 1
) -> dict[str, NDArray[np.float64]]:
    """Give the columns with one of `words` in their names: name to (epochs, values), (2, E)."""
    found = {}
    for name in dict.fromkeys(name for row in history for name in row):
        if words.isdisjoint(re.split(r"[\W_]+", name.lower())):
            continue
        points = [
            (row.get("epoch", position), factor * row[name])
            for position, row in enumerate(history, start=1)
            if name in row and math.isfinite(row[name])
        ]
        found[name] = np.array(points, dtype=np.float64).reshape(-1, 2).T
    return found


def _draw_lines(
    axes: "Axes",
    title: str,
    series: Mapping[str, NDArray[np.float64]],
    *,
    legend_beside: bool = False,
) -> None:
    """Draw one panel."""
    from matplotlib import colormaps
    from matplotlib.ticker import MaxNLocator

    # Strong colors first, then their pale twins; from the 21st line on again, dashed.
    palette = colormaps["tab20"]
    for number, (name, (epochs, values)) in enumerate(series.items()):
        axes.plot(
            epochs,
            values,
            color=palette(2 * number % 20 + number // 10 % 2),
            linestyle="-" if number < 20 else "--",
            marker="o" if len(epochs) < 3 else "",
            linewidth=1.6,
            label=name.replace("_", " "),
        )
    axes.set_title(title)
    axes.set_xlabel("epoch")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    if series and legend_beside:
        axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    elif series:
        axes.legend(fontsize=8, frameon=False)


def _save(figure: "Figure", path: str | Path) -> None:
    with atomic_path(path) as partial:
        figure.savefig(partial, bbox_inches="tight")


def _percent(fraction: float) -> str:
    return "-" if math.isnan(fraction) else f"{100 * fraction:.1f} %"


def _short(count: int) -> str:
    """Write a count in three digits or so: 950, 12.3 k, 1.54 M."""
    for size, unit in ((1_000_000_000, " G"), (1_000_000, " M"), (1_000, " k")):
        if count >= size:
            return f"{count / size:.3g}{unit}"
    return str(count)
