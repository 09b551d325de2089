"""From any format to tables, LAS and label files: equal as written, and no changed value unseen."""

import struct

import numpy as np
import plyfile
import pytest

import bushseg
from bushseg.labels import SCHEMES

BUSH = SCHEMES["bush"]
OUTPUTS = [".ply", ".pcd", ".csv", ".txt", ".las", ".laz", ".label", ".labels"]
NUM_POINTS = 40

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")


def values(rng):
    """A table whose columns' names and types are met in the wild."""
    kinds = [
        *((axis, "f4") for axis in "xyz"),
        *(("red", "u1"), ("green", "u1"), ("blue", "u1")),
        *(("intensity", "f4"), ("scalar_Label", "i4"), ("gps_time", "f8")),
    ]
    table = np.empty(NUM_POINTS, kinds)
    for name, kind in kinds:
        table[name] = rng.integers(0, 6, NUM_POINTS) if kind[0] in "iu" else rng.random(NUM_POINTS)
    return table


def write_ply(path, rng, *, text=False, order="<"):
    element = plyfile.PlyElement.describe(values(rng), "vertex")
    plyfile.PlyData([element], text=text, byte_order="=" if text else order).write(path)


def write_pcd(path, rng, *, text=False):
    table = values(rng)
    sizes = " ".join(str(table.dtype[name].itemsize) for name in table.dtype.names)
    types = " ".join(table.dtype[name].kind.upper() for name in table.dtype.names)
    head = (
        f"VERSION 0.7\nFIELDS {' '.join(table.dtype.names)}\nSIZE {sizes}\nTYPE {types}\n"
        f"WIDTH {NUM_POINTS}\nHEIGHT 1\nPOINTS {NUM_POINTS}\nDATA {'ascii' if text else 'binary'}\n"
    )
    rows = "".join(" ".join(map(repr, row)) + "\n" for row in table.tolist())
    path.write_bytes(head.encode() + (rows.encode() if text else table.tobytes()))


def write_text(path, rng, header="x y z intensity\n"):
    rows = rng.random((NUM_POINTS, 4)).tolist()
    path.write_text(header + "".join(" ".join(map(repr, row)) + "\n" for row in rows))


def write_frame(path, rng):
    rng.random((NUM_POINTS, 4)).astype("<f4").tofile(path)
    codes = rng.integers(0, 6, NUM_POINTS) | rng.integers(0, 9, NUM_POINTS) << 16
    codes.astype("<u4").tofile(path.with_suffix(".label"))


def write_labelled_text(path, rng):
    write_text(path, rng, header="")
    path.with_suffix(".labels").write_text("3\n" * NUM_POINTS)


SOURCES = {
    "binary.ply": write_ply,
    "big.ply": lambda path, rng: write_ply(path, rng, order=">"),
    "ascii.ply": lambda path, rng: write_ply(path, rng, text=True),
    "binary.pcd": write_pcd,
    "ascii.pcd": lambda path, rng: write_pcd(path, rng, text=True),
    "named.xyz": write_text,
    "labelled.txt": write_labelled_text,
    "frame.bin": write_frame,
}


@pytest.fixture
def source(request, write, recipe, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    path = folder / request.param
    if request.param == "scan.laz":
        return write(path, recipe(num_points=NUM_POINTS))
    SOURCES[request.param](path, np.random.default_rng(3))
    return path


@pytest.mark.parametrize("suffix", OUTPUTS)
@pytest.mark.parametrize("source", [*SOURCES, "scan.laz"], indirect=True)
def test_what_is_written_is_equal(source, label, tmp_path, suffix):
    result = bushseg.verify(source, label(source, tmp_path / f"out{suffix}"), BUSH)
    assert result.differences == ()
    assert result.num_points == NUM_POINTS
    if source.name in ("binary.ply", "frame.bin", "labelled.txt", "scan.laz"):
        assert 0 < result.num_changed <= NUM_POINTS


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".las"])
@pytest.mark.parametrize("source", ["binary.ply"], indirect=True)
def test_a_changed_byte_of_a_point_shows(source, label, tmp_path, suffix):
    target = label(source, tmp_path / f"out{suffix}")
    raw = target.read_bytes()
    if suffix == ".las":
        (start,), (length,) = struct.unpack_from("<I", raw, 96), struct.unpack_from("<H", raw, 105)
        kept = [at for at in range(length - 9) if at != 16]
    else:
        length = (3 + 1) * 8 + 3 + 4 + 4 + 9 + 4  # columns, then labels and codes
        start = len(raw) - NUM_POINTS * length
        kept = list(range(length - 13))
    for point in (0, 17, NUM_POINTS - 1):
        for place in kept:
            at = start + point * length + place
            target.write_bytes(raw[:at] + bytes([raw[at] ^ 0x11]) + raw[at + 1 :])
            result = bushseg.verify(source, target, BUSH)
            if suffix == ".las" and place < 12 and place % 4 == 0 and result.equal:
                continue
            assert not result.equal, (point, place)
            if suffix != ".las":
                assert any(f"point {point}: " in line for line in result.differences)


@pytest.mark.parametrize("source", ["named.xyz"], indirect=True)
def test_a_changed_digit_shows(source, label, tmp_path):
    target = label(source, tmp_path / "out.csv")
    lines = target.read_text().split("\n")
    row = lines[8].split(",")
    row[3] = row[3][:-1] + str((int(row[3][-1]) + 5) % 10)
    lines[8] = ",".join(row)
    target.write_text("\n".join(lines))
    (line,) = bushseg.verify(source, target).differences
    assert line.startswith("points: point 7: intensity 0.")
    assert ", was 0." in line


@pytest.mark.parametrize("source", ["binary.ply"], indirect=True)
def test_a_missing_column_shows(source, label, tmp_path):
    target = label(source, tmp_path / "out.ply")
    raw = target.read_bytes()
    target.write_bytes(raw.replace(b" gps_time\n", b" gps_tide\n"))
    assert bushseg.verify(source, target).differences == (
        "columns: gps_time is missing",
        "columns: gps_tide isn't the scan's nor one that labelling adds",
    )


@pytest.mark.parametrize("suffix", [".label", ".labels"])
@pytest.mark.parametrize("source", ["frame.bin"], indirect=True)
def test_label_files_have_a_code_of_the_scheme_for_each_point(source, label, tmp_path, suffix):
    target = label(source, tmp_path / f"out{suffix}")
    raw = target.read_bytes()
    target.write_bytes(raw[:-8] if suffix == ".label" else raw[: raw[:-1].rindex(b"\n") + 1])
    assert "codes, the scan has 40 points" in bushseg.verify(source, target).differences[0]
    changed = (b"\xaa\0\0\0" if suffix == ".label" else b"170\n") + raw[
        4 if suffix == ".label" else raw.index(b"\n") + 1 :
    ]
    target.write_bytes(changed)
    (line,) = bushseg.verify(source, target, BUSH).differences
    assert line == "labels: point 0: code 170, which is no class's"


@pytest.mark.parametrize("suffix", [".ply", ".csv", ".las"])
@pytest.mark.parametrize("source", ["binary.ply"], indirect=True)
def test_a_truncated_output_shows(source, label, tmp_path, suffix):
    target = label(source, tmp_path / f"out{suffix}")
    raw = target.read_bytes()
    target.write_bytes(raw[: len(raw) * 3 // 4])
    assert not bushseg.verify(source, target).equal
