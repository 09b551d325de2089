import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import ReadError
from bushseg.io import ascii as ascii_rows
from bushseg.io.text import is_points, open_text

NAMES_BY_WIDTH = {
    3: ["x", "y", "z"],
    4: ["x", "y", "z", "intensity"],
    5: ["x", "y", "z", "c3", "c4"],
    6: ["x", "y", "z", "red", "green", "blue"],
    7: ["x", "y", "z", "intensity", "red", "green", "blue"],
    8: ["x", "y", "z", "c3", "c4", "c5", "c6", "c7"],
}


def write(folder: Path, content: str | bytes, name: str = "scan.txt") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize("width", NAMES_BY_WIDTH)
@pytest.mark.parametrize("delimiter", [" ", "\t", ",", ";", "   ", ", "])
def test_columns_without_names(tmp_path: Path, width: int, delimiter: str) -> None:
    rows = [[str(10 * row + column) for column in range(width)] for row in range(3)]
    path = write(tmp_path, "\n".join(delimiter.join(row) for row in rows))
    points = open_text(path).read()
    assert points.xyz.tolist() == [[0, 1, 2], [10, 11, 12], [20, 21, 22]]
    assert list(points.attributes) == NAMES_BY_WIDTH[width][3:]
    for column, values in enumerate(points.attributes.values(), start=3):
        assert values.tolist() == [column, 10 + column, 20 + column]
        assert values.dtype == np.float64


@pytest.mark.parametrize(
    "head",
    [
        "z,Y,x,Class\n",
        "# a note\n\n#z,Y,x,Class\n",
        "//z,Y,x,Class\n",
        '"z","Y","x","Class"\r\n',
        "\ufeffz,Y,x,Class\n",
        "2\n# z,Y,x,Class\n",
    ],
)
def test_columns_with_names(tmp_path: Path, head: str) -> None:
    path = write(tmp_path, head + "3,2,1,5\n30,20,10,-1\n", "scan.csv")
    scan = open_text(path)
    points = scan.read()
    assert points.xyz.tolist() == [[1, 2, 3], [10, 20, 30]]
    assert scan.info.label_attribute == "Class"
    assert points.attributes["Class"].tolist() == [5, -1]
    assert points.attributes["Class"].dtype == np.int64


def test_a_number_of_thousands_of_digits_is_a_number_like_any(tmp_path: Path) -> None:
    path = write(tmp_path, "1" * 5000 + "\n0 0 0\n")
    with pytest.raises(ReadError, match="x, y and z"):
        open_text(path)


@pytest.mark.parametrize("names", ["Easting Northing Height", "X Y Z", "id x y z X"])
def test_coordinate_names(tmp_path: Path, names: str) -> None:
    width = len(names.split())
    row = " ".join(map(str, range(width)))
    xyz = open_text(write(tmp_path, f"{names}\n{row}\n")).read().xyz
    assert xyz.tolist() == [[1, 2, 3] if width > 3 else [0, 1, 2]]


def test_blank_lines_and_comments_anywhere(tmp_path: Path) -> None:
    content = b"# x y z\n\n  1 2 3\n   \n# no\n//no\n\t4 5 6\r\n\r\n 7 8 9\n\n"
    scan = open_text(write(tmp_path, content))
    assert scan.info.num_points == 3
    assert scan.read().xyz.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_blocks_do_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    expected = rng.normal(size=(200, 3)) * 1e6
    lines = [f"{x!r} {y!r} {z!r}\n" for x, y, z in expected.tolist()]
    lines.insert(100, "# half\n\n")
    path = write(tmp_path, "".join(lines))
    write(tmp_path, "".join(f"{code}\n" for code in range(200)), "scan.labels")
    for block in (64, 1000, 1 << 20):
        monkeypatch.setattr(ascii_rows, "BLOCK_BYTES", block)
        for size in (1, 7, 1000):
            chunks = list(open_text(path).chunks(size))
            assert max(map(len, chunks)) <= size
            np.testing.assert_array_equal(np.concatenate([c.xyz for c in chunks]), expected)
            codes = np.concatenate([c.attributes["label"] for c in chunks])
            assert codes.tolist() == list(range(200))


def test_semantic3d_labels(tmp_path: Path, samples: dict[str, bytes], xyz: np.ndarray) -> None:
    path = write(tmp_path, samples["semantic3d.txt"], "station1_xyz_intensity_rgb.txt")
    write(tmp_path, b"8\n0\n", "station1_xyz_intensity_rgb.labels")
    scan = open_text(path)
    points = scan.read()
    np.testing.assert_array_equal(points.xyz, xyz)
    assert points.attributes["intensity"].tolist() == [-1800, 7]
    assert points.attributes["blue"].tolist() == [30, 3]
    assert scan.info.label_attribute == "label"
    assert points.attributes["label"].tolist() == [8, 0]


def test_labels_beside_a_label_column(tmp_path: Path) -> None:
    path = write(tmp_path, b"x y z label\n0 0 0 1\n")
    write(tmp_path, b"2\n", "scan.labels")
    scan = open_text(path)
    points = scan.read()
    assert points.attributes["label"].tolist() == [1]
    assert scan.info.label_attribute is not None
    assert points.attributes[scan.info.label_attribute].tolist() == [2]


@pytest.mark.parametrize(
    ("labels", "message"),
    [(b"1\n", "1 labels"), (b"1\n2\n3\n", "3 labels"), (b"1\nbush\n", "line 2"), (b"", "empty")],
)
def test_refuses_labels_that_do_not_fit(tmp_path: Path, labels: bytes, message: str) -> None:
    path = write(tmp_path, b"0 0 0\n1 1 1\n")
    write(tmp_path, labels, "scan.labels")
    with pytest.raises(ReadError, match=message):
        open_text(path).read()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"# only a comment\n", "no points"),
        (b"x,y,z\n", "at its beginning"),
        (b"a note\nand another\n", "numbers below the header"),
        (b"1 2\n3 4\n", "x, y and z"),
        (b"x y z\n1 2 3 4\n", "3 column names over rows of 4"),
        (b"a b c\n1 2 3\n", "the columns a, b, c"),
        (b"\x00\x01\x02\n", "binary"),
        ("1 2 3\n".encode("utf-16"), "binary"),
        (b"3\n1 2 3\n4 5 6\n", "as its first line says"),
        (b"1 2 3\n" + b"4" * 100_000, "longer than"),
        (b"1 2 3\r4 5 6\r", "carriage return"),
        (b"1 2 3\r\r\n4 5 6\r\r\n", "carriage return"),
    ],
)
def test_refuses_at_the_beginning(tmp_path: Path, content: bytes, message: str) -> None:
    path = write(tmp_path, content)
    with pytest.raises(ReadError, match=message):
        open_text(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"1 2 3\n4 5\n7 8 9\n", "line 2 is '4 5'"),
        (b"1 2 3\n\n# c\n4 5 6\n7 8 9 10\n", "line 5 is '7 8 9 10'"),
        (b"x,y,z\n1,2,3\n4,,6\n", "line 3 is '4,,6'"),
        (b"1 2 3\n4 5 6\n7 8 9e\n", "line 3 is '7 8 9e'"),
        (b"1 2 3\n4 5 \xff\n", "line 2"),
        (b"x y z class\n1 2 3 4\n1 2 3 4.5\n", "line 3"),
    ],
)
def test_names_the_malformed_line(tmp_path: Path, content: bytes, message: str) -> None:
    scan = open_text(write(tmp_path, content))
    with pytest.raises(ReadError, match=message):
        scan.read()


def test_the_malformed_line_is_found_among_many(tmp_path: Path) -> None:
    lines = ["1 2 3\n"] * 999
    lines[700] = "1 2 x\n"
    with pytest.raises(ReadError, match="line 701 is '1 2 x'"):
        open_text(write(tmp_path, "".join(lines))).read()


def test_is_points(tmp_path: Path) -> None:
    assert is_points(write(tmp_path, b"1 2 3\n"))
    assert not is_points(write(tmp_path, b"Dear reader,\nthese are scans.\n"))
    assert not is_points(write(tmp_path, b"epoch,loss\n1,0.5\n"))
    assert not is_points(write(tmp_path, b""))


def test_a_line_without_end_takes_no_more_than_a_block(tmp_path: Path) -> None:
    path = tmp_path / "endless.txt"
    with path.open("wb") as file:
        file.write(b"1 2 3\n1 2 ")
        for _ in range(64):
            file.write(b"3" * (1 << 20))
    tracemalloc.start()
    try:
        with pytest.raises(ReadError, match="longer than"):
            open_text(path)
        assert tracemalloc.get_traced_memory()[1] < 3 * ascii_rows.BLOCK_BYTES
    finally:
        tracemalloc.stop()
