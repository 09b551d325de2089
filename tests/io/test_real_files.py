"""Scans from other programs, each read a second time by a library that isn't ours."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bushseg import io
from bushseg.errors import ReadError

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no real scans at {DATA}")


def files(*patterns: str) -> list[Path]:
    found = sorted(path for pattern in patterns for path in DATA.glob(pattern))
    return found or [DATA / "none"]


def name_of(path: Path) -> str:
    return path.name


@pytest.mark.parametrize("path", files("edge/*/*.ply", "forest/*.ply"), ids=name_of)
def test_ply_against_plyfile(path: Path) -> None:
    plyfile = pytest.importorskip("plyfile")
    vertex = plyfile.PlyData.read(path)["vertex"]
    points = io.read(path)
    expected = np.stack([vertex[axis] for axis in "xyz"], axis=1).astype(np.float64)
    np.testing.assert_array_equal(points.xyz, expected)
    names = [item.name for item in vertex.properties if item.name not in "xyz"]
    assert list(points.attributes) == names
    for name in names:
        np.testing.assert_array_equal(points.attributes[name], vertex[name])


@pytest.mark.parametrize("name", ["binary", "binary_compressed", "ascii_with_underscore"])
def test_pcd_variants_agree(name: str) -> None:
    folder = DATA / "edge" / "pypcd4"
    expected = io.read(folder / "tests__pcd__ascii.pcd")
    points = io.read(folder / f"tests__pcd__{name}.pcd")
    np.testing.assert_array_equal(points.xyz, expected.xyz)
    assert len(points) == 213


def test_pcd_against_numpy() -> None:
    path = DATA / "forest" / "moving_ground_t0.pcd"
    expected = np.loadtxt(path, skiprows=11, dtype=np.float32)
    points = io.read(path)
    assert len(points) == 74_521
    np.testing.assert_array_equal(points.xyz, expected[:, :3])
    np.testing.assert_array_equal(points.attributes["intensity"], expected[:, 3])


def test_frame_against_its_bytes() -> None:
    path = DATA / "frames" / "seq00_000000.bin"
    points = io.read(path)
    assert (
        points.xyz.astype("<f4").tobytes()
        == np.fromfile(path, "<f4").reshape(-1, 4)[:, :3].tobytes()
    )
    packed = np.fromfile(path.with_suffix(".label"), "<u4")
    np.testing.assert_array_equal(points.attributes["label"], packed % 65536)
    np.testing.assert_array_equal(points.attributes["instance"], packed // 65536)
    counts = Counter(points.attributes["label"].tolist())
    assert counts[70] > 1000  # vegetation


@pytest.mark.parametrize("path", files("edge/e57-asmaloney/*.e57"), ids=name_of)
def test_e57_against_pye57(path: Path) -> None:
    pye57 = pytest.importorskip("pye57")
    readable = ("ColouredCube", "bunny", "ColourRepresentation")
    if not any(word in path.name for word in readable):
        with pytest.raises(ReadError):
            io.read(path)
        return
    fields = ["cartesianX", "cartesianY", "cartesianZ"]
    with pye57.E57(str(path)) as file:
        header = file.get_header(0)
        fields += [name for name in ["cartesianInvalidState"] if name in header.point_fields]
        raw, buffers = file.make_buffers(fields, header.point_count)
        header.points.reader(buffers).read()
    points = io.read(path)
    expected = np.stack([raw[f"cartesian{axis}"] for axis in "XYZ"], axis=1)
    valid = raw.get("cartesianInvalidState", np.zeros(len(expected))) == 0
    np.testing.assert_array_equal(points.xyz[valid], expected[valid])
    assert np.isnan(points.xyz[~valid]).all()
    assert len(points) == len(expected)


@pytest.mark.parametrize(
    "path",
    files(
        "edge/pypcd/*.pcd", "edge/lfs/*", "edge/pypcd4/*invalid*.pcd", "edge/pypcd4/*_empty_*.pcd"
    ),
    ids=name_of,
)
def test_refuses(path: Path) -> None:
    with pytest.raises(ReadError):
        io.read(path)
