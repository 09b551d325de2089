"""LAS to LAS: a faithful copy is equal, and no changed byte goes unseen."""

import struct

import laspy
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bushseg
from bushseg.errors import ReadError
from bushseg.labels import SCHEMES
from bushseg.prediction import predict_file

BUSH = SCHEMES["bush"]

pytestmark = [
    pytest.mark.filterwarnings("ignore::UserWarning:laspy"),
    # laspy takes the range of scaled floats that are drawn bit by bit, NaN among them.
    pytest.mark.filterwarnings("ignore::RuntimeWarning:laspy"),
]

FORMATS = [
    (version, point_format)
    for version, count in {"1.0": 2, "1.1": 2, "1.2": 4, "1.3": 6, "1.4": 11}.items()
    for point_format in range(count)
]
EXTRAS = (
    laspy.ExtraBytesParams("height", "f4"),
    laspy.ExtraBytesParams("scaled", "i2", scales=np.array([0.1]), offsets=np.array([5.0])),
    laspy.ExtraBytesParams("triple", "3u1"),
)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(("version", "point_format"), FORMATS)
def test_a_faithful_copy_is_equal(write, label, recipe, tmp_path, version, point_format, suffix):
    evlrs = version == "1.4"
    wanted = recipe(version, point_format, EXTRAS, evlrs=evlrs, crs_in_evlr=evlrs)
    source = write(tmp_path / "a.las", wanted)
    result = bushseg.verify(source, label(source, tmp_path / f"b{suffix}"), BUSH)
    assert result.differences == ()
    assert result.equal
    assert result.num_points == 40
    assert 0 < result.num_changed <= 40
    assert result.declared == (
        "class_index added",
        "confidence added",
        "bush_probability added",
    )


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("version", "point_format", "options"),
    [
        ("1.0", 1, {}),
        ("1.2", 3, {}),
        ("1.3", 4, {"undescribed": 3}),
        ("1.4", 7, {"extras": EXTRAS, "crs_in_evlr": True}),
        ("1.4", 10, {"extras": EXTRAS[:1]}),
    ],
)
def test_a_changed_byte_shows_wherever_it_is(
    write, label, recipe, tmp_path, version, point_format, options, step
):
    wanted = recipe(version, point_format, num_points=6, **options)
    source = write(tmp_path / "a.las", wanted)
    target = label(source, tmp_path / "b.las")
    raw = target.read_bytes()
    (points,), (length,) = struct.unpack_from("<I", raw, 96), struct.unpack_from("<H", raw, 105)
    (kept,) = struct.unpack_from("<H", source.read_bytes(), 105)
    unseen = []
    for at in range(len(raw) % step, len(raw), step):
        inside, place = divmod(at - points, length)
        is_share = 0 <= inside < 6 and place > kept  # any share may be another one
        is_code = 0 <= inside < 6 and place == (16 if point_format >= 6 else 15)
        if is_share or is_code:
            continue
        target.write_bytes(raw[:at] + bytes([raw[at] ^ 0x15]) + raw[at + 1 :])
        if bushseg.verify(source, target, BUSH).equal:
            unseen.append(at)
    assert unseen == []


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("GUID", "header: GUID"),
        ("scale", "header: scales"),
        ("count", "counts and bounds: 64-bit counts"),
        ("bounds", "counts and bounds: max x"),
        ("vlr", "VLRs: VLR 1, someone 3: byte 2 of its content differs"),
        ("crs", "CRS: VLR 2, LASF_Projection 2112: byte 0 of its content differs"),
        ("intensity", "point records: point 0: intensity 1"),
        ("height", "point records: point 0: height"),
        ("classification", "labels: point 199: class code 77 for class_index"),
        ("class_index", "labels: point 0: class_index 1"),
        ("confidence", "labels: point 0: confidence"),
    ],
)
def test_a_difference_says_what_and_where(write, label, recipe, tmp_path, place, expected):
    source = write(tmp_path / "a.las", recipe("1.4", 6, EXTRAS[:1], num_points=200))
    target = label(source, tmp_path / "b.las")
    raw = bytearray(target.read_bytes())
    (points,) = struct.unpack_from("<I", raw, 96)
    at, value = {
        "GUID": (8, 1),
        "scale": (131, 1),
        "count": (255, 99),  # points of the first return
        "bounds": (185, 0),
        "vlr": (raw.index(b" payload"), 1),
        "crs": (raw.index(b"PROJCRS["), 1),
        "intensity": (points + 12, raw[points + 12] ^ 1),
        "classification": (points + 199 * 43 + 16, 77),
        "height": (points + 30, raw[points + 30] ^ 1),
        "class_index": (points + 34, 100),
        "confidence": (points + 38, 0xFF),
    }[place]
    raw[at] = value
    if place == "intensity":
        struct.pack_into("<H", raw, points + 12, 1)
    target.write_bytes(raw)
    differences = bushseg.verify(source, target, BUSH).differences
    assert any(line.startswith(expected) for line in differences), differences


def test_order_counts(write, label, recipe, tmp_path):
    source = write(tmp_path / "a.las", recipe("1.2", 1))
    target = label(source, tmp_path / "b.las")
    raw = bytearray(target.read_bytes())
    (start,), (length,) = struct.unpack_from("<I", raw, 96), struct.unpack_from("<H", raw, 105)
    first, second = raw[start : start + length], raw[start + length : start + 2 * length]
    raw[start : start + 2 * length] = second + first
    target.write_bytes(raw)
    (line, *_) = bushseg.verify(source, target).differences
    assert line.startswith("point records: point 0: X ")
    assert line.endswith("(2 of 40 points differ)")


def test_a_damaged_laz_is_seen_or_decodes_to_the_same(write, label, recipe, tmp_path):
    """Also where the decompressor panics or aborts: that is another process."""
    source = write(tmp_path / "a.las", recipe("1.4", 7, EXTRAS))
    target = label(source, tmp_path / "b.laz")
    raw, expected = target.read_bytes(), laspy.read(target).points.array.copy()
    (points,) = struct.unpack_from("<I", raw, 96)
    places = np.random.default_rng(2).integers(points, len(raw), 12).tolist()
    for at in [points + 7, *places, len(raw) - 3]:
        target.write_bytes(raw[:at] + bytes([raw[at] ^ 0x55]) + raw[at + 1 :])
        result = bushseg.verify(source, target, BUSH)
        if result.equal:
            found = laspy.read(target).points.array
            shared = [name for name in found.dtype.names if name not in ("confidence",)]
            assert all((found[name] == expected[name]).all() for name in shared[:10])
    target.write_bytes(raw[:-40])
    assert not bushseg.verify(source, target).equal


def test_a_scan_labelled_before_is_written_over(write, label, recipe, tmp_path):
    source = write(tmp_path / "a.las", recipe(extras=EXTRAS))
    once = label(source, tmp_path / "once.las", 1)
    twice = label(once, tmp_path / "twice.las", 2)
    result = bushseg.verify(once, twice, BUSH)
    assert result.differences == ()
    assert result.declared[0] == "class_index written over"
    assert bushseg.verify(source, twice, BUSH).equal


def test_dimensions_that_have_the_names_already_survive(write, label, recipe, tmp_path):
    own = (
        laspy.ExtraBytesParams("class_index", "f8"),
        laspy.ExtraBytesParams("confidence", "f4", scales=np.array([2.0]), offsets=np.zeros(1)),
    )
    source = write(tmp_path / "a.las", recipe(extras=own))
    target = label(source, tmp_path / "b.las")
    assert bushseg.verify(source, target, BUSH).differences == ()
    raw = bytearray(target.read_bytes())
    (points,) = struct.unpack_from("<I", raw, 96)
    raw[points + 36] ^= 1
    target.write_bytes(raw)
    (line,) = bushseg.verify(source, target, BUSH).differences
    assert line.startswith("point records: point 0: class_index ")


def test_dimensions_named_alike(write, label, recipe, tmp_path):
    extras = tuple(laspy.ExtraBytesParams(name, "u1") for name in ("one", "two"))
    source = write(tmp_path / "a.las", recipe(extras=extras))
    raw = source.read_bytes().replace(b"two".ljust(32, b"\0"), b"one".ljust(32, b"\0"))
    source.write_bytes(raw)
    assert bushseg.verify(source, label(source, tmp_path / "b.laz"), BUSH).differences == ()


def test_waveforms_beside_the_scan_must_come_along(write, label, recipe, tmp_path):
    source = write(tmp_path / "a.las", recipe("1.3", 4))
    raw = bytearray(source.read_bytes())
    raw[6] |= 0x04
    source.write_bytes(raw)
    target = label(source, tmp_path / "b.las")
    source.with_suffix(".wdp").write_bytes(b"waves")
    (line,) = bushseg.verify(source, target).differences
    assert line == "waveforms: b.wdp is missing; copy a.wdp to it"
    target.with_suffix(".wdp").write_bytes(b"wave?")
    assert bushseg.verify(source, target).differences == ("waveforms: b.wdp isn't a.wdp",)
    target.with_suffix(".wdp").write_bytes(b"waves")
    assert bushseg.verify(source, target).equal


def test_another_number_of_points(write, label, recipe, tmp_path):
    source = write(tmp_path / "a.las", recipe())
    shorter = write(tmp_path / "c.las", recipe(num_points=39))
    (line,) = bushseg.verify(source, label(shorter, tmp_path / "b.las")).differences
    assert line == "counts and bounds: 39 points, were 40"


def test_a_broken_output_is_a_difference_and_a_broken_input_an_error(write, recipe, tmp_path):
    source, broken = write(tmp_path / "a.las", recipe()), tmp_path / "b.las"
    broken.write_bytes(source.read_bytes()[:300])
    assert bushseg.verify(source, broken).differences[0].startswith("file: a header of")
    with pytest.raises(ReadError, match=r"b\.las: a header of"):
        bushseg.verify(broken, source)
    with pytest.raises(ReadError, match="no such file"):
        bushseg.verify(source, tmp_path / "none.las")


names = st.sampled_from(["a", "height", "confidence", "ExtraBytes", "intensity_", "é" * 10])
kinds = st.sampled_from(["u1", "i2", "f4", "f8", "u8", "3f4", "2u2"])


@st.composite
def extra_dimensions(draw):
    found = {}
    for name in draw(st.lists(names, unique=True, max_size=4)):
        kind = draw(kinds)
        scaled = draw(st.booleans()) and kind[0] in "iuf"
        options = {"scales": np.array([0.5]), "offsets": np.array([1.0])} if scaled else {}
        found[name] = laspy.ExtraBytesParams(name, kind, **options)
    return tuple(found.values())


def check_prediction(
    write, recipe, model, folder, form, extras, undescribed, crs_in_evlr, seed, suffix
):
    wanted = recipe(
        *form,
        extras,
        crs_in_evlr=crs_in_evlr and form[0] == "1.4",
        undescribed=undescribed,
        num_points=60,
        seed=seed,
    )
    source, target = write(folder / "a.las", wanted), folder / f"b{suffix}"
    predict_file(source, target, model, overwrite=True)
    result = bushseg.verify(source, target, BUSH)
    assert result.differences == ()
    raw = target.read_bytes()
    if suffix == ".las":  # and what is changed then is seen
        (points,) = struct.unpack_from("<I", raw, 96)
        at = points + seed % 12
        target.write_bytes(raw[:at] + bytes([raw[at] ^ 0x40]) + raw[at + 1 :])
        assert not bushseg.verify(source, target, BUSH).equal


ANY_SCAN = given(
    form=st.sampled_from([("1.1", 1), ("1.2", 2), ("1.3", 5), *(("1.4", n) for n in range(11))]),
    extras=extra_dimensions(),
    undescribed=st.integers(0, 3),
    crs_in_evlr=st.booleans(),
    seed=st.integers(0, 100),
    suffix=st.sampled_from([".las", ".laz"]),
)
FOLDER = HealthCheck.function_scoped_fixture  # a scan takes the place of the one before


@settings(max_examples=6, suppress_health_check=[FOLDER])
@ANY_SCAN
def test_what_predict_writes_is_equal(write, recipe, height_model, tmp_path, **options):
    check_prediction(write, recipe, height_model, tmp_path, **options)


@pytest.mark.slow
@settings(max_examples=100, suppress_health_check=[FOLDER])
@ANY_SCAN
def test_what_predict_writes_is_equal_many_times(write, recipe, height_model, tmp_path, **options):
    check_prediction(write, recipe, height_model, tmp_path, **options)
