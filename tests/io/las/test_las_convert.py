"""Scans of other formats as LAS, read back by laspy."""

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg.errors import WriteError
from bushseg.io.base import ScanInfo, ScanReader
from bushseg.io.las import create_las, open_las
from bushseg.points import PointCloud

XYZ = np.array([(0.0, 0.0, 0.0), (1.5, -2.25, 0.125), (69_999.0, 60_000.125, 88.0)])


class ArrayReader(ScanReader):
    """A scan that comes from arrays, two points at a time."""

    def __init__(self, points, info):
        self.points, self.info = points, info

    def chunks(self, size=2):
        for start in range(0, len(self.points), size):
            part = slice(start, start + size)
            columns = {name: values[part] for name, values in self.points.attributes.items()}
            yield PointCloud(self.points.xyz[part], columns)


@pytest.fixture
def convert(tmp_path):
    """Write points of a scan that isn't LAS, chunk by chunk; the path written."""

    def run(xyz, attributes=None, added=None, codes=None, suffix=".las", crs=None):
        attributes, added = attributes or {}, added or {}
        dtypes = {name: np.asarray(values).dtype for name, values in attributes.items()}
        info = ScanInfo(tmp_path / "a.ply", "PLY", len(xyz), dtypes, crs=crs)
        points = PointCloud(
            np.asarray(xyz, float), {k: np.asarray(v) for k, v in attributes.items()}
        )
        source = ArrayReader(points, info)
        path = tmp_path / ("b" + suffix)
        with create_las(path, source, {name: v.dtype for name, v in added.items()}) as writer:
            start = 0
            for chunk in source.chunks(2):
                part = slice(start, start + len(chunk))
                columns = {name: values[part] for name, values in added.items()}
                writer.write(chunk, columns, None if codes is None else codes[part])
                start += len(chunk)
        return path

    return run


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_a_bare_scan_becomes_point_format_6(convert, suffix):
    las = laspy.read(convert(XYZ, suffix=suffix, codes=np.array([2, 255, 0])))
    assert str(las.header.version) == "1.4"
    assert las.header.point_format.id == 6
    assert las.header.global_encoding.wkt
    np.testing.assert_array_equal(las.classification, [2, 255, 0])
    np.testing.assert_array_equal(las.return_number, [1, 1, 1])
    assert las.header.are_points_compressed == (suffix == ".laz")
    np.testing.assert_allclose(las.xyz, XYZ, atol=0.5001e-4)


def test_a_wide_scan_is_kept_to_a_millimetre_from_its_middle(convert):
    xyz = XYZ * [50, 1, 1] + [0, 6.6e6, 0]
    las = laspy.read(convert(xyz))
    np.testing.assert_allclose(las.xyz, xyz, atol=0.5001e-3)
    np.testing.assert_array_equal(las.header.offsets, [1749975, 6629999, 0])


@settings(max_examples=60, deadline=None)
@given(
    xyz=st.lists(st.tuples(*[st.floats(-500, 500)] * 3), min_size=1, max_size=9),
    shift=st.sampled_from([0.0, 6.6e6]),
)
def test_coordinates_keep_seven_digits_of_the_extent(tmp_path_factory, xyz, shift):
    array = np.array(xyz) + shift
    path = tmp_path_factory.mktemp("seven") / "b.las"
    source = ArrayReader(PointCloud(array), ScanInfo(path, "PLY", len(array), {}))
    with create_las(path, source, {}) as writer:
        for chunk in source.chunks():
            writer.write(chunk, {}, None)
    extent = max(1e-3, float((array.max(axis=0) - array.min(axis=0)).max()))
    with open_las(path) as reader:
        error = np.abs(reader.read().xyz - array).max()
        assert error <= extent / 1e7 + 2e-9  # the second: float64 at 6,600 km
        assert (reader.info.bounds[0] <= array.min(axis=0) + 1e-4).all()


def test_degrees_keep_their_precision(convert):
    xyz = np.array([(7.123456789, 51.987654321, 100.0), (7.123556789, 51.987754321, 100.001)])
    np.testing.assert_allclose(laspy.read(convert(xyz)).xyz, xyz, atol=1e-9)


def test_points_at_the_origin_stay_exactly_there(convert):
    xyz = np.array([(0.0, 0.0, 0.0), (83.2, -14.7, 3.1), (-22.7, 61.3, -1.9)])
    with open_las(convert(xyz)) as reader:
        assert (reader.read().xyz[0] == 0).all()


@pytest.mark.parametrize(
    ("names", "values", "stored"),
    [
        (("red", "green", "blue"), np.array([0, 7, 255], "u1"), [0, 1799, 65535]),
        (("r", "g", "b"), np.array([0, 256, 65535], "u2"), [0, 256, 65535]),
        (("R", "G", "B"), np.array([0, 10, 255], "f8"), [0, 2570, 65535]),
        (
            ("diffuse_red", "diffuse_green", "diffuse_blue"),
            np.array([0.0, 1, 1]),
            [0, 65535, 65535],
        ),
    ],
)
def test_colors_of_any_naming_fill_16_bits(convert, names, values, stored):
    las = laspy.read(convert(XYZ, dict.fromkeys(names, values)))
    assert las.header.point_format.id == 7
    for field in ("red", "green", "blue"):
        np.testing.assert_array_equal(las[field], stored)
    assert not list(las.point_format.extra_dimension_names)


def test_one_factor_for_all_three_colors(convert):
    colors = {"red": np.zeros(3, "u2"), "green": np.zeros(3, "u2"), "blue": [0, 9, 3000]}
    np.testing.assert_array_equal(laspy.read(convert(XYZ, colors)).blue, [0, 9, 3000])


@pytest.mark.parametrize(
    ("values", "stored", "is_kept"),
    [
        (np.array([0, 7, 65535], "u2"), [0, 7, 65535], False),
        (np.array([-1800, 7, 90000], "i4"), [0, 7, 65535], True),
        (np.array([0, 0.5, 1], "f4"), [0, 32768, 65535], True),
        (np.array([0, np.nan, 300], "f4"), [0, 0, 300], True),
        (np.array([0, 200, 255], "f8"), [0, 200, 255], False),
    ],
)
def test_intensity_is_shown_and_never_lost(convert, values, stored, is_kept):
    las = laspy.read(convert(XYZ, {"intensity": values}))
    np.testing.assert_array_equal(las.intensity, stored)
    if is_kept:
        np.testing.assert_array_equal(las["original_intensity"], values)
        assert las["original_intensity"].dtype == values.dtype
    else:
        assert not list(las.point_format.extra_dimension_names)


def test_all_other_columns_become_extra_bytes(convert):
    attributes = {
        "gps_time": np.array([1.5, 2.5, np.nan]),
        "return_number": np.array([5, 6, 7], "i8"),
        "half": np.array([0.5, 1, 2], "f2"),
        "flag": np.array([True, False, True]),
        "normals": np.arange(9, dtype="f4").reshape(3, 3),
        "ä" * 40: np.array([1, 2, 3], "u4"),
    }
    added = {"half": np.array([7, 8, 9], "f4"), "bush": np.array([0.1, 0.2, 0.3], "f8")}
    las = laspy.read(convert(XYZ, attributes, added))
    np.testing.assert_array_equal(las.gps_time, attributes["gps_time"])
    np.testing.assert_array_equal(las["return_number_2"], [5, 6, 7])
    np.testing.assert_array_equal(las["flag"], [1, 0, 1])
    for part in range(3):
        np.testing.assert_array_equal(las[f"normals_{part}"], attributes["normals"][:, part])
    np.testing.assert_array_equal(las["ä" * 16], [1, 2, 3])
    np.testing.assert_array_equal(las["half"], added["half"])  # same name and stored dtype
    np.testing.assert_array_equal(las["bush"], added["bush"])


def test_a_wkt_crs_travels_and_other_text_does_not(convert):
    wkt = 'PROJCRS["x",BASEGEOGCRS["y"]]'
    with open_las(convert(XYZ, crs=wkt)) as reader:
        assert reader.info.crs == wkt
    with open_las(convert(XYZ, crs="GeoTIFF keys: GTModelType=1")) as reader:
        assert reader.info.crs is None


def test_what_las_can_not_hold_is_refused(convert, tmp_path):
    bad = XYZ.copy()
    bad[1, 2] = np.nan
    with pytest.raises(WriteError, match=r"1 points .* NaN or infinite .* choose \.ply"):
        convert(bad)
    bad[1, 2] = 1e10
    with pytest.raises(WriteError, match=r"spans 10,000,000,\d+ m"):
        convert(bad)
    with pytest.raises(WriteError, match="can't hold 'name'"):
        convert(XYZ, {"name": np.array(["a", "b", "c"])})
    with pytest.raises(WriteError, match="class code 256"):
        convert(XYZ, codes=np.array([1, 2, 256]))
