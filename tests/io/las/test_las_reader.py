import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from bushseg.io.las import open_las

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")


def concatenated(reader, size):
    chunks = list(reader.chunks(size))
    assert all(0 < len(chunk) <= size for chunk in chunks)
    names = chunks[0].attributes
    xyz = np.concatenate([chunk.xyz for chunk in chunks])
    return xyz, {name: np.concatenate([c.attributes[name] for c in chunks]) for name in names}


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_every_version_and_format_reads_as_laspy_does(
    make_las, patch_file, version, point_format, suffix
):
    path = make_las("a" + suffix, version=version, point_format=point_format)
    with open_las(path) as reader:
        xyz, attributes = concatenated(reader, 7)
        info = reader.info
    if version == "1.0":
        patch_file(path, 25, "B", 1)
    expected = laspy.read(path)
    kind = "LAZ" if suffix == ".laz" else "LAS"
    assert info.format == f"{kind} {version} point format {point_format}"
    assert info.num_points == len(xyz) == 100
    assert info.label_attribute == "classification"
    assert info.crs == 'PROJCRS["a",BASEGEOGCRS["b"]]'
    np.testing.assert_array_equal(info.bounds, [expected.header.mins, expected.header.maxs])
    np.testing.assert_array_equal(xyz, expected.xyz)
    packed = {"X", "Y", "Z", "bit_fields", "raw_classification", "classification_flags"}
    names = set(expected.point_format.dimension_names) - packed
    assert names <= set(attributes)
    assert {name: column.dtype for name, column in attributes.items()} == info.attributes
    for name in names:
        np.testing.assert_array_equal(attributes[name], np.asarray(expected[name]), err_msg=name)


def test_coordinates_are_scaled_in_float64(make_las):
    path = make_las("a.las", count=1)
    record = np.frombuffer(path.read_bytes()[-36:-24], "<i4")
    with open_las(path) as reader:
        expected = record * np.array([0.01, 0.02, 0.003]) + np.array([1e6, 6.6e6, -100])
        np.testing.assert_array_equal(reader.read().xyz, [expected])


def test_chunks_start_over_and_one_iteration_does_not_disturb_another(make_las):
    with open_las(make_las("a.laz")) as reader:
        for first, second in zip(reader.chunks(30), reader.chunks(30), strict=True):
            np.testing.assert_array_equal(first.xyz, second.xyz)
        assert [len(chunk) for chunk in reader.chunks(30)] == [30, 30, 30, 10]


def test_record_holds_the_files_own_bytes(make_las, parts):
    path = make_las("a.las", version="1.2", point_format=3)
    with open_las(path) as reader:
        raw = np.concatenate([chunk.record.view(np.uint8) for chunk in reader.chunks(33)])
    np.testing.assert_array_equal(raw.reshape(100, 34), parts(path).records)


def test_extra_bytes_scaled_plain_and_in_pairs(make_las):
    extras = (
        laspy.ExtraBytesParams("height", "u2", scales=[0.5], offsets=[-10.0]),
        laspy.ExtraBytesParams("plain", "f4"),
        laspy.ExtraBytesParams("pair", "2i2", scales=[2.0, 3.0], offsets=[0.0, 1.0]),
    )
    path = make_las("a.laz", extras=extras)
    with open_las(path) as reader:
        points = reader.read()
    raw = points.record
    assert reader.info.attributes["height"] == np.float64
    assert reader.info.attributes["plain"] == np.float32
    np.testing.assert_array_equal(points.attributes["height"], raw["height"] * 0.5 - 10)
    np.testing.assert_array_equal(
        points.attributes["plain"].view(np.uint32), raw["plain"].copy().view(np.uint32)
    )
    np.testing.assert_array_equal(points.attributes["pair"], raw["pair"] * [2.0, 3.0] + [0.0, 1.0])


def test_extra_bytes_of_one_name_both_survive(make_las):
    extras = (laspy.ExtraBytesParams("aa", "u1"), laspy.ExtraBytesParams("ab", "u2"))
    path = make_las("a.las", extras=extras)
    path.write_bytes(path.read_bytes().replace(b"ab\0\0", b"aa\0\0", 1))
    with open_las(path) as reader:
        attributes = reader.read().attributes
    assert attributes["aa"].dtype == np.uint8
    assert attributes["aa_2"].dtype == np.uint16


def test_undescribed_extra_bytes_come_whole(make_las, parts):
    path = make_las("a.las", extras=(laspy.ExtraBytesParams("aa", "u4"),))
    path.write_bytes(path.read_bytes().replace(b"LASF_Spec\0", b"SomeoneEl\0", 1))
    with open_las(path) as reader:
        column = reader.read().attributes["ExtraBytes"]
    np.testing.assert_array_equal(column, parts(path).records[:, -4:])


def test_an_extra_dimension_named_like_a_standard_one_does_not_hide_it(make_las):
    path = make_las("a.las", extras=(laspy.ExtraBytesParams("intensitY", "u1"),))
    path.write_bytes(path.read_bytes().replace(b"intensitY", b"intensity", 1))
    with open_las(path) as reader:
        assert reader.info.attributes["intensity"] == np.uint16
        assert reader.info.attributes["intensity_2"] == np.uint8


def test_geotiff_keys_in_words(tmp_path):
    header = laspy.LasHeader(version="1.2", point_format=0)
    keys = [1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 32632, 1026, 34737, 4, 0]
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", struct.pack("<16H", *keys)))
    header.vlrs.append(laspy.VLR("LASF_Projection", 34737, "", b"UTM|"))
    path = tmp_path / "a.las"
    with laspy.open(path, "w", header=header) as writer:
        writer.write_points(laspy.ScaleAwarePointRecord.zeros(1, header=header))
    with open_las(path) as reader:
        assert reader.info.crs == (
            "GeoTIFF keys: GTModelType=1, ProjectedCRS=32632, GTCitation='UTM'"
        )


def test_a_count_only_in_the_legacy_field_is_believed(make_las, patch_file):
    path = make_las("a.las", point_format=3)
    patch_file(path, 107, "I", 100)
    patch_file(path, 247, "Q", 0)
    with open_las(path) as reader:
        assert reader.info.num_points == len(reader.read()) == 100


def test_real_files_read_as_laspy_reads_them(scans: Path):
    names = ["laz-rs/tests__data__point-version-1-point-wise.laz", "rlas/inst__extdata__fwf.laz"]
    names += ["laspy/tests__data__simple_with_page.copc.laz", "LASzip/pnacl__example__test.laz"]
    for name in names:
        path = scans / "edge" / name
        if not path.exists():
            pytest.skip(f"no {path}")
        with open_las(path) as reader:
            raw = np.concatenate([chunk.record.view(np.uint8) for chunk in reader.chunks(999)])
        if "pnacl" in name:  # laspy can't read it
            reference = path.parent.parent / "libLAS" / "test__data__1.2-with-color.las"
            expected = Path(reference).read_bytes()[-1065 * 34 :]
        else:
            expected = laspy.read(path).points.array.tobytes()
        assert raw.tobytes() == expected, name
