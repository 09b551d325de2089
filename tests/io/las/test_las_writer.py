import struct
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bushseg.errors import WriteError
from bushseg.io.las import create_las, open_las
from bushseg.io.las_header import RECORD_SIZES
from bushseg.io.las_points import parse_layout
from bushseg.io.las_writer import set_classification

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")

SUFFIXES = [".las", ".laz"]
ADDED = {"bush": np.dtype("f4"), "class_index": np.dtype("i2")}


def label(source, target, added=None, codes=None, size=33):
    """Copy a scan as predict does: chunk by chunk, with constant columns and codes."""
    added = added or {}
    with open_las(source) as reader:
        dtypes = {name: values.dtype for name, values in added.items()}
        with create_las(target, reader, dtypes) as writer:
            start = 0
            for chunk in reader.chunks(size):
                part = slice(start, start + len(chunk))
                columns = {name: values[part] for name, values in added.items()}
                writer.write(chunk, columns, None if codes is None else codes[part])
                start += len(chunk)
    return target


def columns(count=100):
    return {
        "bush": np.linspace(0, 1, count, dtype="f4"),
        "class_index": np.arange(count, dtype="i2") - 1,
    }


def raw_records(path, parts):
    """The records' bytes, read by nobody of ours."""
    if path.suffix == ".las":
        return parts(path).records
    array = laspy.read(path).points.array
    return np.frombuffer(array.tobytes(), np.uint8).reshape(len(array), -1)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_byte_survives_but_the_class_code(make_las, parts, version, point_format, suffix):
    source = make_las("a.las", version=version, point_format=point_format)
    codes = np.arange(100) % 32
    target = label(source, source.with_name("b" + suffix), columns(), codes)
    if version == "1.0":  # laspy doesn't read it
        raw = bytearray(target.read_bytes())
        raw[25] = 1
        target.write_bytes(raw)
    before, after = parts(source), parts(target)
    old, new = before.records, raw_records(target, parts)
    place = 15 if point_format < 6 else 16
    kept = [at for at in range(old.shape[1]) if at != place]
    np.testing.assert_array_equal(new[:, kept], old[:, kept])
    if point_format < 6:
        np.testing.assert_array_equal(new[:, place], (old[:, place] & 0xE0) | codes)
    else:
        np.testing.assert_array_equal(new[:, place], codes)
    assert new[:, old.shape[1] :].tobytes() == b"".join(
        struct.pack("<fh", a, b) for a, b in zip(*columns().values(), strict=True)
    )
    # identity, date, scales, offsets; bounds too, for they were right; what follows the header
    assert after.raw[:25] == before.raw[:25]
    assert after.raw[26:96] == before.raw[26:96]
    assert after.raw[131:235] == before.raw[131:235]
    size = before.get("H", 94)[0]
    assert after.raw[size - 17 : size] == before.raw[size - 17 : size] == b"behind the header"
    (points,) = after.get("I", 96)
    assert after.raw[points - 17 : points] == b"before the points"[-17:]
    assert after.vlrs[:2] == before.vlrs
    assert [head[2:18].rstrip(b"\0") for head, _ in after.vlrs[2:]] == (
        [b"LASF_Spec", b"laszip encoded"] if suffix == ".laz" else [b"LASF_Spec"]
    )


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_plain_copy_is_the_same_file(make_las, suffix):
    source = make_las("a.las", version="1.4", evlrs=True)
    target = label(source, source.with_name("b" + suffix))
    if suffix == ".las":
        assert target.read_bytes() == source.read_bytes()
    else:
        again = label(target, source.with_name("c.las"))
        assert again.read_bytes() == source.read_bytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_evlrs_follow_the_points(make_las, parts, suffix):
    source = make_las("a.laz", evlrs=True)
    target = label(source, source.with_name("b" + suffix), columns())
    assert parts(target).evlrs == parts(source).evlrs
    assert len(laspy.read(target).evlrs) == 2


def with_waveform(path, minor):
    """Append a waveform EVLR and say so in the header."""
    raw = bytearray(path.read_bytes())
    struct.pack_into("<Q", raw, 227, len(raw))
    raw[6] |= 2
    if minor == 4:
        struct.pack_into("<QI", raw, 235, len(raw), 1)
    payload = bytes(range(200))
    raw += struct.pack("<H16sHQ32s", 0, b"LASF_Spec", 65535, len(payload), b"waves") + payload
    path.write_bytes(raw)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("minor", "number"), [(3, 4), (3, 5), (4, 9), (4, 10)])
def test_waveforms_move_and_the_header_knows_where(make_las, parts, suffix, minor, number):
    source = make_las("a.las", version=f"1.{minor}", point_format=number)
    with_waveform(source, minor)
    target = label(source, source.with_name("b" + suffix), columns())
    before, after = parts(source), parts(target)
    (old,), (new,) = before.get("Q", 227), after.get("Q", 227)
    assert new != old
    assert after.raw[new : new + 260] == before.raw[old : old + 260]
    assert len(after.raw) == new + 260
    if minor == 4:
        assert after.get("QI", 235) == (new, 1)


@pytest.mark.parametrize("number", [9, 10])
def test_waveforms_that_lazrs_garbles_are_refused(make_las, parts, number):
    source = make_las("a.las", point_format=number)
    raw = bytearray(source.read_bytes())
    raw[parts(source).get("I", 96)[0] + 15] ^= 0x10
    source.write_bytes(raw)
    with pytest.raises(WriteError, match=r"several scanner channels.*choose \.las"):
        label(source, source.with_name("b.laz"))
    np.testing.assert_array_equal(
        parts(label(source, source.with_name("b.las"))).records, parts(source).records
    )


def test_counts_and_bounds_are_what_the_points_are(make_las, parts, patch_file):
    source = make_las("a.las", version="1.4", point_format=6)
    right = parts(source).get("6d", 179)
    patch_file(source, 179, "6d", *[0.0] * 6)
    patch_file(source, 255, "15Q", *[9] * 15)
    after = parts(label(source, source.with_name("b.las")))
    np.testing.assert_allclose(after.get("6d", 179), right, rtol=1e-15)
    returns = after.records[:, 14] & 0x0F
    assert after.get("15Q", 255) == tuple(int((returns == n).sum()) for n in range(1, 16))
    assert after.get("I5I", 107) == (0,) * 6


def test_old_versions_count_the_first_five_returns(make_las, parts):
    source = make_las("a.las", version="1.2", point_format=1)
    after = parts(label(source, source.with_name("b.las")))
    returns = after.records[:, 14] & 0x07
    assert after.get("6I", 107) == (100, *(int((returns == n).sum()) for n in range(1, 6)))


def test_labelling_again_replaces_the_columns(make_las):
    source = make_las("a.laz")
    first = label(source, source.with_name("b.laz"), columns())
    second = label(first, source.with_name("c.laz"), {**columns(), "bush": np.ones(100, "f4")})
    with open_las(second) as reader, open_las(first) as before:
        assert list(reader.info.attributes) == list(before.info.attributes)
        assert (reader.read().attributes["bush"] == 1).all()


def test_a_taken_name_of_another_type_gets_a_suffix(make_las):
    scaled = laspy.ExtraBytesParams("class_index", "i2", scales=[2.0], offsets=[0.0])
    source = make_las("a.las", extras=(laspy.ExtraBytesParams("bush", "u1"), scaled))
    added = {**columns(), "intensity": np.arange(100, dtype="u2")}
    target = label(source, source.with_name("b.las"), added)
    las = laspy.read(target)
    np.testing.assert_array_equal(las["bush_2"], added["bush"])
    np.testing.assert_array_equal(las["class_index_2"], added["class_index"])
    np.testing.assert_array_equal(las["intensity_2"], added["intensity"])
    np.testing.assert_array_equal(las["bush"], laspy.read(source)["bush"])


def test_two_long_names_do_not_share_a_dimension(make_las):
    added = {"n" * 40: np.zeros(100, "u1"), "n" * 41: np.ones(100, "u1")}
    target = label(make_las("a.las"), make_las("b.las"), added)
    with open_las(target) as reader:
        attributes = reader.read().attributes
    assert (attributes["n" * 32] == 0).all()
    assert (attributes["n" * 30 + "_2"] == 1).all()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_undescribed_and_duplicate_extra_bytes_survive(make_las, parts, suffix):
    extras = (laspy.ExtraBytesParams("aa", "u1"), laspy.ExtraBytesParams("ab", "u2"))
    for old, new in [(b"ab\0\0", b"aa\0\0"), (b"LASF_Spec\0", b"SomeoneEl\0")]:
        source = make_las("a.las", extras=extras)
        source.write_bytes(source.read_bytes().replace(old, new, 1))
        target = label(source, source.with_name("b" + suffix), columns())
        with open_las(target) as reader:
            points = reader.read()
        raw = points.record.view(np.uint8).reshape(100, -1)
        np.testing.assert_array_equal(raw[:, :-6], parts(source).records)
        np.testing.assert_array_equal(points.attributes["bush"], columns()["bush"])


def test_a_copc_index_does_not_outlive_its_chunks(make_las, parts):
    source = make_las("a.las", evlrs=True)
    raw = source.read_bytes().replace(b"someone\0", b"copc\0\0\0\0", 2)
    source.write_bytes(raw)
    target = label(source, source.with_name("b.laz"))
    assert [head[2:6] for head, _ in parts(target).vlrs] == [b"LASF", b"lasz"]
    assert [head[2:6] for head, _ in parts(target).evlrs] == [b"else"]


def test_a_code_that_does_not_fit_is_refused(make_las):
    source = make_las("a.las", version="1.2", point_format=3)
    with pytest.raises(WriteError, match="class code 32 in point format 3, which holds 0 to 31"):
        label(source, source.with_name("b.las"), codes=np.full(100, 32))
    source = make_las("a.las")
    for code in (-1, 256):
        with pytest.raises(WriteError, match=f"class code {code} in point format 7"):
            label(source, source.with_name("b.las"), codes=np.full(100, code))


@given(raw=arrays(np.uint8, 20), codes=arrays(np.int64, 20, elements=st.integers(0, 31)))
def test_flags_beside_the_code_stay(raw, codes):
    records = np.zeros(20, [("raw_classification", "u1")])
    records["raw_classification"] = raw
    set_classification(records, codes, 3)
    np.testing.assert_array_equal(records["raw_classification"] >> 5, raw >> 5)
    np.testing.assert_array_equal(records["raw_classification"] & 31, codes)


def test_what_las_can_not_hold_is_refused(make_las, tmp_path):
    with open_las(make_las("a.las")) as reader:
        with pytest.raises(WriteError, match=r"can't hold 'z', which is complex128"):
            create_las(tmp_path / "b.las", reader, {"z": np.dtype("c16")})
        with pytest.raises(WriteError, match="can't write"):
            create_las(tmp_path / "no" / "b.las", reader, {})


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_copy_given_up_midway_lets_go_of_both_files(make_las, suffix):
    source = make_las("a.las")
    with open_las(source) as reader:
        writer = create_las(source.with_name("b" + suffix), reader, {})

        def give_up():
            with writer:
                writer.write(next(reader.chunks(33)), {}, None)
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            give_up()
        assert writer._source.closed
        assert writer._sink._file.closed


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_is_one_clear_error(make_las, tmp_path):
    (tmp_path / "b.las").symlink_to("/dev/full")
    with pytest.raises(WriteError, match=r"can't write \(No space left on device\)"):
        label(make_las("a.las"), tmp_path / "b.las")


@given(st.binary(max_size=500), st.integers(0, 60), st.sampled_from([0, 6]))
def test_any_descriptors_account_for_every_byte(payload, num_extra, point_format):
    layout = parse_layout(point_format, num_extra, payload)
    assert layout.dtype.itemsize == RECORD_SIZES[point_format] + num_extra
    grown, name = layout.with_added("bush", np.dtype("f4"))
    assert grown.dtype.itemsize == layout.dtype.itemsize + 4
    again = parse_layout(point_format, num_extra + 4, b"".join(grown.described()))
    assert again.dtype.names[-1] == name
    assert again.dtype == grown.dtype


REAL = [
    *("forest/autzen_test.copc.laz", "forest/bcts_1.laz", "ign/extra_byte_bloc_350m.laz"),
    *("edge/laspy/tests__data__1_4_w_evlr.laz", "edge/rlas/inst__extdata__fwf.laz"),
    *("edge/laspy/tests__data__unregistered_extra_bytes.las", "edge/laspy/test__v13-output.las"),
]


@pytest.mark.parametrize("name", REAL)
def test_real_scans_keep_every_field(scans, tmp_path, name):
    source = scans / name
    if not source.exists():
        pytest.skip(f"no {source}")
    before = laspy.read(source)
    codes = np.arange(len(before)) % 32
    after = laspy.read(label(source, tmp_path / "b.laz", columns(len(before)), codes, size=300_000))
    assert len(after) == len(before)
    names = [n for n in before.point_format.dimension_names if "classification" not in n]
    assert len(names) > 10
    for field in names:
        a, b = np.asarray(before[field]), np.asarray(after[field])
        np.testing.assert_array_equal(a, b, err_msg=field)
    np.testing.assert_array_equal(after["classification"], codes)
    np.testing.assert_array_equal(after["bush"], columns(len(before))["bush"])
    for name in ("uuid", "version", "creation_date", "generating_software", "system_identifier"):
        assert getattr(after.header, name) == getattr(before.header, name), name
    np.testing.assert_array_equal(after.header.scales, before.header.scales)
    np.testing.assert_array_equal(after.header.offsets, before.header.offsets)
