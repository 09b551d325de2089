"""Pictures: that they are drawn, of a sensible size, and show what they are given."""

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import WriteError
from bushseg.metrics import ConfusionMatrix
from bushseg.plots import _draw_lines, _series, _short, plot_confusion, plot_curves


def png_size(path: Path) -> tuple[int, int]:
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", content[16:24])
    return width, height


@pytest.mark.parametrize("num_classes", [1, 2, 8, 19])
def test_confusion_of_any_size(tmp_path: Path, num_classes: int) -> None:
    matrix = ConfusionMatrix(num_classes)
    labels = np.arange(num_classes).repeat(3)
    matrix.update(np.roll(labels, 1), labels)
    plot_confusion(matrix, [f"class {i}" for i in range(num_classes)], tmp_path / "confusion.png")
    width, height = png_size(tmp_path / "confusion.png")
    assert 0.6 < width / height < 2.2
    assert max(width, height) < 2500


def test_confusion_without_points_or_with_misses(tmp_path: Path) -> None:
    matrix = ConfusionMatrix(2)
    plot_confusion(matrix, ["a", "b"], tmp_path / "empty.png")
    matrix.update(np.array([-1, 0]), np.array([0, 0]))
    plot_confusion(matrix, ["a", "b"], tmp_path / "missed.png")
    assert png_size(tmp_path / "missed.png")[0] > png_size(tmp_path / "empty.png")[0]


def test_curves(tmp_path: Path) -> None:
    history: list[dict[str, float]] = [
        {"epoch": 1, "train_loss": 2.0, "train_miou": 0.2, "learning_rate": 0.01},
        {"epoch": 2, "train_loss": 1.0, "train_miou": 0.4, "iou_bush": 0.3, "iou_tree": np.nan},
    ]
    for name, rows in (("none", []), ("one", history[:1]), ("two", history)):
        plot_curves(rows, tmp_path / f"{name}.png")
        width, height = png_size(tmp_path / f"{name}.png")
        assert 2 < width / height < 5


def test_series_are_chosen_by_the_words_in_their_names() -> None:
    history: list[dict[str, float]] = [
        {"loss": 2.0, "val_oa": 0.5, "val/iou/road": 0.1},
        {"loss": float("nan"), "val_oa": 0.6},
        {"loss": 1.0, "epoch": 7, "iou_road": 0.2},
    ]
    loss = _series(history, {"loss"})
    assert list(loss) == ["loss"]
    assert loss["loss"].tolist() == [[1, 7], [2, 1]]
    assert _series(history, {"miou", "oa"}, 100)["val_oa"].tolist() == [[1, 2], [50, 60]]
    # "road" holds "oa" but isn't the word.
    assert list(_series(history, {"miou", "oa"})) == ["val_oa"]
    assert list(_series(history, {"iou"})) == ["val/iou/road", "iou_road"]


def test_lines_are_told_apart() -> None:
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    series = {f"class_{i}": np.array([[1.0, 2.0, 3.0], [0.0, 1.0, 2.0]]) for i in range(25)}
    _draw_lines(axes, "title", series, legend_beside=True)
    looks = {(line.get_color(), line.get_linestyle()) for line in axes.lines}
    assert len(looks) == 25
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.texts][:2] == ["class 0", "class 1"]


def test_pyplot_stays_out(tmp_path: Path) -> None:
    code = (
        "import sys; from bushseg.plots import plot_curves;"
        f"plot_curves([{{'loss': 1.0}}], {str(tmp_path / 'curves.png')!r});"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_unwritable_folder_is_one_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(WriteError):
        plot_curves([], tmp_path / "file" / "curves.png")


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0"), (950, "950"), (12_345, "12.3 k"), (1_544_202, "1.54 M")]
)
def test_short_counts(count: int, text: str) -> None:
    assert _short(count) == text
