"""Reports on scans whose every number is known."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from laspy.vlrs.known import WktCoordinateSystemVlr

from bushseg.info import ScanReport, describe

DATA = Path(__file__).parents[2] / "shared" / "data"
FEET = 'PROJCRS["a",BASEGEOGCRS["b",UNIT["degree",0.017]],LENGTHUNIT["US survey foot",0.3048]]'
METRES = FEET.replace("US survey foot", "metre")


def write_ply(path: Path, columns: dict[str, list[float]]) -> Path:
    rows = "\n".join(" ".join(map(str, row)) for row in zip(*columns.values(), strict=True))
    header = "".join(f"property double {name}\n" for name in columns)
    count = len(next(iter(columns.values())))
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex {count}\n{header}end_header\n{rows}\n")
    return path


def write_las(path: Path, crs: str | None = None, shift: float = 0.0) -> Path:
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=7))
    las.header.scales, las.header.offsets = [0.01] * 3, [0.0] * 3
    if crs is not None:
        las.header.vlrs.append(WktCoordinateSystemVlr(crs))
    las.x, las.y, las.z = np.array([[0.5, 0.5, 1], [0.6, 0.4, 2], [3.5, 0.5, 3], [9, -7, 4]]).T
    las.classification = [2, 2, 5, 5]
    las.intensity = [7, 7, 7, 8]
    las.red = [9, 9, 9, 9]
    las.write(str(path))
    if shift:
        raw = bytearray(path.read_bytes())
        raw[179:187] = np.array([9 - shift]).tobytes()  # the header's largest x
        path.write_bytes(raw)
    return path


def test_las(tmp_path: Path) -> None:
    report = describe(write_las(tmp_path / "a.las", METRES))
    assert report.error is None
    assert report.format == "LAS 1.4 point format 7"
    assert report.num_points == 4
    assert report.bounds == ((0.5, -7.0, 1.0), (9.0, 0.5, 4.0))
    assert report.density == 4 / 3
    assert report.crs == METRES
    assert report.classes == {2: 2, 5: 2}
    assert report.label_attribute == "classification"
    assert report.attributes["intensity"] == (7, 8)
    assert report.features == ("intensity",)  # the colors never change
    assert report.faults == []


def test_lines_put_what_never_changes_on_one(tmp_path: Path) -> None:
    lines = list(describe(write_las(tmp_path / "a.las")).lines())
    assert lines[0].endswith("a.las: LAS 1.4 point format 7, 4 points")
    assert (
        "  extent      8.50 x 7.50 x 3.00, from (0.500, -7.000, 1.000) to (9.000, 0.500, 4.000)"
        in (lines)
    )
    assert "  density     1.3 points per occupied square unit" in lines
    assert "  CRS         not stated" in lines
    assert "  features    intensity, height" in lines
    assert "  intensity                    7 to 8" in lines
    assert "  classes     (classification) 2: 2, 5: 2" in lines
    (constants,) = [line for line in lines if line.startswith("  constant ")]
    assert "red 9" in constants
    assert "withheld 0" in constants


def test_a_crs_in_feet_is_a_fault(tmp_path: Path) -> None:
    (fault,) = describe(write_las(tmp_path / "a.las", FEET)).faults
    assert "feet" in fault


def test_points_outside_the_headers_bounds(tmp_path: Path) -> None:
    (fault,) = describe(write_las(tmp_path / "a.las", shift=2.5)).faults
    assert fault == "points lie up to 2.50 outside the bounds that the header states"


def test_values_that_are_not_finite(tmp_path: Path) -> None:
    nan, inf = float("nan"), float("inf")
    columns = {
        "x": [0, nan, 1],
        "y": [0, 0, 0],
        "z": [0, 0, -inf],
        "label": [3, inf, nan],
        "intensity": [nan, nan, inf],
    }
    report = describe(write_ply(tmp_path / "a.ply", columns))
    assert report.num_points == 3
    assert report.bounds == ((0, 0, 0), (0, 0, 0))
    assert report.density == 1
    assert report.classes == {3: 1}
    assert report.attributes == {"label": (3, 3), "intensity": None}
    assert report.features == ()
    assert report.faults == ["2 points are not finite; they will get no label"]
    assert "  intensity                    no finite value" in list(report.lines())


def test_no_finite_point_at_all(tmp_path: Path) -> None:
    columns = {"x": [float("nan")], "y": [0.0], "z": [0.0]}
    report = describe(write_ply(tmp_path / "a.ply", columns))
    assert report.bounds is None
    assert report.density == 0
    assert len(list(report.lines())) == 4  # heading, CRS, features, fault


def test_no_returns_count_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    np.array([[0, 0, 0, 0], [5, 5, 1, 0.5], [5.1, 5, 1, 0.6]], "<f4").tofile(path)
    report = describe(path)
    assert report.num_points == 3
    assert report.bounds is not None
    assert report.bounds[0][:2] == (5, 5)
    assert report.density == 2
    assert report.faults == ["1 pulses did not return (0, 0, 0); they will get no label"]


def test_whole_numbers_in_full_and_no_data_marks_short() -> None:
    report = ScanReport(Path("a"), attributes={"id": (1.0, 7_654_321.0), "tree": (0.25, 1e308)})
    lines = list(report.lines())
    assert "  id                           1 to 7,654,321" in lines
    assert "  tree                         0.25 to 1e+308" in lines


@pytest.mark.parametrize("content", [b"", b"version https://git-lfs.github.com/spec/v1\n"])
def test_what_cant_be_read_is_reported_not_raised(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.laz"
    path.write_bytes(content)
    report = describe(path)
    assert report.error is not None
    assert list(report.lines()) == [f"error: {report.error}"]


def test_missing_file(tmp_path: Path) -> None:
    assert "no such file" in str(describe(tmp_path / "none.las").error)


@given(
    arrays(
        np.float32, st.tuples(st.integers(1, 40), st.just(4)), elements=st.floats(1, 60, width=32)
    )
)
def test_density_counts_occupied_cells(
    tmp_path_factory: pytest.TempPathFactory, rows: np.ndarray
) -> None:
    path = tmp_path_factory.mktemp("frame") / "a.bin"
    rows.astype("<f4").tofile(path)
    cells = {(np.floor(x), np.floor(y)) for x, y, *_ in rows.tolist()}
    assert describe(path).density == len(rows) / len(cells)


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no real scans at {DATA}")
def test_real_scan_in_feet() -> None:
    report = describe(DATA / "forest" / "autzen_test.copc.laz")
    assert report.format == "COPC LAZ 1.4 point format 7"
    assert report.num_points == 61_201
    assert report.features == ("rgb", "intensity")
    assert report.classes[5] == 29_080
    assert len(report.faults) == 1
    assert "feet" in report.faults[0]
