"""Evaluations of files against files, and what they write."""

import csv
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from bushseg.errors import DataError, ReadError
from bushseg.evaluation import Evaluation, evaluate, evaluate_arrays
from bushseg.labels import SCHEMES, ClassInfo, ClassScheme
from bushseg.progress import Silent

BUSH = SCHEMES["bush"]
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
XYZ = np.array([(500_000 + x, 5_400_000, 90) for x in range(5)], dtype=np.float64)
# ground, bush, bush, unlabelled, tree
TRUE_CODES = [2, 4, 4, 0, 5]
CODES = [2, 4, 5, 4, 5]
INDICES = [0, 2, 3, 2, 255]


class Notes(Silent):
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.done = 0

    def advance(self, amount: int) -> None:
        self.done += amount

    def note(self, message: str) -> None:
        self.lines.append(message)


def write_csv(path: Path, xyz: NDArray[np.float64] = XYZ, **columns: Sequence[float]) -> Path:
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["x", "y", "z", *columns])
        rows.writerows(zip(*xyz.T.tolist(), *columns.values(), strict=True))
    return path


def write_las(
    path: Path, codes: list[int], indices: list[int] | None = None, scale: float = 0.001
) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, scale), XYZ[0]
    if indices is not None:
        header.add_extra_dim(laspy.ExtraBytesParams("class_index", np.uint8))
    las = laspy.LasData(header)
    las.x, las.y, las.z = XYZ.T
    las.classification[:] = codes
    if indices is not None:
        las["class_index"][:] = indices
    las.write(path)
    return path


def check(evaluation: Evaluation) -> None:
    """Of four labelled points, ground and one bush are right, one bush is called a tree."""
    assert evaluation.num_points == 5
    assert evaluation.num_ignored == 1
    counts = evaluation.confusion.counts
    assert (counts[0, 0], counts[2, 2], counts[2, 3]) == (1, 1, 1)
    assert_allclose(evaluation.confusion.iou[2], 1 / 2)


def test_arrays() -> None:
    evaluation = evaluate_arrays(np.array([0, 2, 3, 2, -1]), np.array([0, 2, 2, -1, 3]), BUSH)
    check(evaluation)
    assert evaluation.confusion.missed[3] == 1


def test_two_scans_by_code(tmp_path: Path) -> None:
    prediction = write_csv(tmp_path / "p.csv", classification=CODES)
    truth = write_csv(tmp_path / "t.csv", classification=TRUE_CODES)
    notes = Notes()
    evaluation = evaluate(prediction, truth, BUSH, progress=notes)
    check(evaluation)
    assert evaluation.confusion.counts[3, 3] == 1
    assert (notes.done, notes.lines) == (5, [])


def test_class_index_is_preferred(tmp_path: Path) -> None:
    prediction = write_las(tmp_path / "p.las", [1] * 5, INDICES)
    truth = write_las(tmp_path / "t.las", TRUE_CODES)
    evaluation = evaluate(prediction, truth, BUSH)
    check(evaluation)
    assert evaluation.confusion.missed[3] == 1
    by_code = evaluate(prediction, truth, BUSH, prediction_field="classification")
    assert by_code.confusion.missed.sum() == 4


def test_one_file_with_both(tmp_path: Path) -> None:
    check(evaluate(write_las(tmp_path / "p.las", TRUE_CODES, INDICES), None, BUSH))
    both = write_csv(tmp_path / "p.csv", label=TRUE_CODES, predicted_label=CODES)
    check(evaluate(both, None, BUSH))
    named = write_csv(tmp_path / "n.csv", first=TRUE_CODES, second=CODES)
    check(evaluate(named, None, BUSH, prediction_field="second", truth_field="first"))


def test_a_column_is_not_compared_with_itself(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "p.csv", label=CODES, other=CODES)
    for truth in (None, path):
        with pytest.raises(DataError, match="'label' would be compared with itself"):
            evaluate(path, truth, BUSH)
    assert evaluate(path, path, BUSH, truth_field="other").confusion.oa == 1


def test_a_frames_own_labels_are_no_prediction(tmp_path: Path) -> None:
    np.ones((5, 4), "<f4").tofile(tmp_path / "frame.bin")
    for name, codes in (("frame.label", TRUE_CODES), ("prediction.label", CODES)):
        np.array(codes, "<u4").tofile(tmp_path / name)
    with pytest.raises(DataError, match=r"frame\.label: 'label' would be compared with itself"):
        evaluate(tmp_path / "frame.label", tmp_path / "frame.bin", BUSH)
    check(evaluate(tmp_path / "prediction.label", tmp_path / "frame.bin", BUSH))


@pytest.mark.parametrize("suffix", [".labels", ".label"])
def test_bare_codes(tmp_path: Path, suffix: str) -> None:
    prediction, truth = tmp_path / f"p{suffix}", write_csv(tmp_path / "t.csv", label=TRUE_CODES)
    if suffix == ".label":
        (np.array(CODES, "<u4") + (7 << 16)).tofile(prediction)
    else:
        prediction.write_text("".join(f"{code}\n" for code in CODES))
    check(evaluate(prediction, truth, BUSH))


def test_a_coarse_las_file_may_round(tmp_path: Path) -> None:
    coarse = write_las(tmp_path / "p.las", CODES, scale=0.5)
    shifted = XYZ + 0.2
    check(evaluate(coarse, write_csv(tmp_path / "t.csv", shifted, label=TRUE_CODES), BUSH))
    with pytest.raises(DataError, match="apart"):
        evaluate(coarse, write_csv(tmp_path / "t.csv", XYZ + 0.6, label=TRUE_CODES), BUSH)


def test_unknown_codes_are_counted_and_told(tmp_path: Path) -> None:
    prediction = write_csv(tmp_path / "p.csv", class_index=[0, 2, 3, 2, 9])
    truth = write_csv(tmp_path / "t.csv", label=[2, 4, 4, 200, -1])
    notes = Notes()
    evaluation = evaluate(prediction, truth, BUSH, progress=notes)
    assert evaluation.num_ignored == 2
    assert evaluation.unknown_predictions.codes == {9: 1}
    assert evaluation.unknown_truth.codes == {200: 1, -1: 1}
    assert notes.lines == [
        "p.csv: 1 points hold codes that scheme 'bush' doesn't know and count as no prediction: "
        "9 (1)",
        "t.csv: 2 points hold codes that scheme 'bush' doesn't know and are ignored: "
        "-1 (1), 200 (1)",
    ]


def test_values_that_are_no_codes(tmp_path: Path) -> None:
    prediction = write_csv(tmp_path / "p.csv", guess=[2, 4, 5.5, 1e300, float("nan")])
    truth = write_csv(tmp_path / "t.csv", label=TRUE_CODES)
    evaluation = evaluate(prediction, truth, BUSH, prediction_field="guess")
    assert evaluation.unknown_predictions.invalid == 3
    assert evaluation.confusion.missed.sum() == 2


def test_truth_in_another_scheme(tmp_path: Path) -> None:
    prediction = write_csv(tmp_path / "p.csv", class_index=INDICES)
    # Semantic3D: natural terrain, low vegetation twice, unlabelled, high vegetation.
    truth = write_csv(tmp_path / "t.csv", label=[2, 4, 4, 0, 3])
    check(evaluate(prediction, truth, BUSH, truth_scheme=SCHEMES["semantic3d"]))


def test_truth_without_labels_is_refused(tmp_path: Path) -> None:
    prediction = write_csv(tmp_path / "p.csv", label=CODES)
    truth = write_csv(tmp_path / "t.csv", label=[0, 0, 1, 90, 90])
    with pytest.raises(DataError, match=r"no point has a label .* \(unknown codes: 90 \(2\)\)"):
        evaluate(prediction, truth, BUSH)


def test_missing_files(tmp_path: Path) -> None:
    for name in ("absent.las", "absent.label"):
        with pytest.raises(ReadError, match="no such file"):
            evaluate(tmp_path / name, None, BUSH)


def test_as_dict_and_files(tmp_path: Path) -> None:
    scheme = ClassScheme(
        name="two",
        classes=(ClassInfo(name="soil", codes=(1,)), ClassInfo(name="hedge wild", codes=(2,))),
    )
    evaluation = evaluate_arrays(np.array([0, 0, -1]), np.array([0, 0, 0]), scheme)
    evaluation.unknown_truth.codes[77] = 4
    evaluation.write(tmp_path / "new" / "folder")
    folder = tmp_path / "new" / "folder"
    assert sorted(path.name for path in folder.iterdir()) == [
        "confusion.csv",
        "confusion.png",
        "metrics.json",
        "per_class.csv",
    ]
    stored = json.loads((folder / "metrics.json").read_text())
    assert stored == evaluation.as_dict()
    assert stored["oa"] == stored["miou"] == pytest.approx(2 / 3)
    assert stored["num_missed"] == 1
    assert stored["unknown_truth"] == {"codes": {"77": 4}, "invalid": 0}
    assert stored["classes"]["hedge wild"] == {
        "iou": None,
        "precision": None,
        "recall": None,
        "f1": None,
        "support": 0,
    }
    with (folder / "confusion.csv").open() as file:
        assert list(csv.reader(file)) == [
            ["true class", "soil", "hedge wild", "(none)"],
            ["soil", "2", "0", "1"],
            ["hedge wild", "0", "0", "0"],
        ]
    with (folder / "per_class.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["class", "iou", "precision", "recall", "f1", "support"]
    assert rows[1][0] == "soil"
    assert [float(value) for value in rows[1][1:]] == pytest.approx([2 / 3, 1, 2 / 3, 0.8, 3])
    assert rows[2] == ["hedge wild", "", "", "", "", "0"]


def test_a_real_frame_against_its_labels(tmp_path: Path) -> None:
    frame = DATA / "frames" / "seq00_000000.bin"
    if not frame.exists():
        pytest.skip(f"no {frame}")
    codes = np.fromfile(frame.with_suffix(".label"), "<u4") & 0xFFFF
    wrong = np.where(np.arange(len(codes)) % 10 == 0, 70, codes)
    wrong.astype("<u4").tofile(tmp_path / "prediction.label")
    scheme = SCHEMES["semantickitti"]
    evaluation = evaluate(tmp_path / "prediction.label", frame, scheme)
    labels = scheme.encode(codes).labels
    assert evaluation.num_points == len(codes)
    assert evaluation.num_ignored == np.count_nonzero(labels == -1)
    right = (scheme.encode(wrong).labels == labels)[labels != -1]
    assert evaluation.confusion.oa == pytest.approx(right.mean())


def test_a_real_airborne_tile(tmp_path: Path) -> None:
    tile = DATA / "ign" / "KM_1.laz"
    if not tile.exists():
        pytest.skip(f"no {tile}")
    notes = Notes()
    copy = shutil.copy(tile, tmp_path)
    evaluation = evaluate(copy, tile, SCHEMES["asprs"], progress=notes)
    assert evaluation.confusion.support.tolist()[:4] == [4402, 191, 84, 152]
    assert evaluation.confusion.oa == 1
    assert evaluation.unknown_truth.codes == {64: 902}
    assert len(notes.lines) == 2


def test_calibration_of_a_file_that_says_how_sure_it_is(tmp_path: Path) -> None:
    """Of the labelled points with a prediction two are right, at 0.9 and 0.6, one wrong at 0.8."""
    sure = [0.9, 0.6, 0.8, 0.5, 0.0]
    prediction = write_csv(tmp_path / "p.csv", class_index=INDICES, confidence=sure)
    truth = write_csv(tmp_path / "t.csv", classification=TRUE_CODES)
    evaluation = evaluate(prediction, truth, BUSH)
    check(evaluation)
    assert_allclose(evaluation.confidence.error, (0.1 + 0.4 + 0.8) / 3)
    assert_allclose(evaluation.as_dict()["mean_confidence"], 2.3 / 3)
    bare = write_csv(tmp_path / "b.csv", class_index=INDICES)
    assert evaluate(bare, truth, BUSH).as_dict()["ece"] is None
