import csv

import pytest

from bushseg.history import summarize, write_history

ROW = {"epoch": 2.0, "loss": 0.5, "train_oa": 0.9, "train_miou": 0.4, "points_per_second": 12345.0}


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(39.6, "40 s left"), (700, "12 min left"), (3600 + 290, "1 h 5 min left")],
)
def test_a_line_says_how_long_the_rest_takes(seconds, said):
    assert summarize(ROW, 30, seconds) == (
        f"epoch 2/30  loss 0.500  training crops: mIoU 40.0%, OA 90.0%  12,345 points/s  {said}"
    )


def test_the_last_line_has_nothing_left():
    assert "left" not in summarize(ROW, 2, 0)


def test_a_held_out_split_is_what_counts():
    row = {**ROW, "val_oa": 0.8, "val_miou": 0.3, "val_iou/bush": 0.25, "val_iou/car": float("nan")}
    line = summarize(row, 30, 0)
    assert "held out: mIoU 30.0%, OA 80.0%  bush 25%" in line
    assert "car" not in line


def test_a_metric_that_comes_later_gets_its_column(tmp_path):
    write_history(tmp_path / "metrics.csv", [ROW, {**ROW, "val_oa": 0.8}])
    with (tmp_path / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["val_oa"] for row in rows] == ["", "0.8"]
