"""The built-in schemes, and users' own."""

from pathlib import Path

import numpy as np
import pytest

from bushseg.errors import SchemeError
from bushseg.labels import (
    SCHEMES,
    ClassInfo,
    ClassScheme,
    describe_legacy_loss,
    dump_scheme,
    fit_legacy,
    load_scheme,
    parse_scheme,
)

FRAMES = Path(__file__).resolve().parents[2] / "shared" / "data" / "frames"

ORCHARD = """
name = "orchard"
unlabelled = [0]
bush_class = "hedge"

[[classes]]
name = "soil"
codes = [1, 2]
color = "#a0782d"
asprs = 2
bush = "ground"

[[classes]]
name = "hedge"
codes = [7]
"""


@pytest.mark.parametrize("name", SCHEMES)
def test_every_scheme_is_whole(name: str) -> None:
    scheme = load_scheme(name)
    assert scheme.name == name
    assert len({info.color for info in scheme.classes}) == scheme.num_classes
    labels = np.arange(-1, scheme.num_classes)
    assert scheme.encode(scheme.decode(labels)).labels.tolist() == labels.tolist()
    assert parse_scheme(dump_scheme(scheme)) == scheme


def test_class_counts() -> None:
    counts = {name: scheme.num_classes for name, scheme in SCHEMES.items()}
    assert counts == {
        "bush": 7,
        "asprs": 15,
        "semantic3d": 8,
        "rellis": 14,
        "rellis11": 11,
        "semantickitti": 19,
    }


def test_bush_codes_are_what_it_writes() -> None:
    bush = SCHEMES["bush"]
    labels = np.arange(-1, bush.num_classes)
    assert bush.to_asprs(labels).tolist() == bush.decode(labels).tolist()
    assert [info.bush for info in bush.classes] == list(bush.names)
    assert bush.encode(np.array([0, 1, 7, 18])).labels.tolist() == [-1] * 4
    assert bush.names[bush.encode(np.array([4])).labels[0]] == "bush"


@pytest.mark.parametrize(
    ("name", "code", "bush"),
    [
        ("semantic3d", 4, "bush"),
        ("semantic3d", 3, "tree"),
        ("semantic3d", 7, None),
        ("rellis", 19, "bush"),
        ("rellis11", 3, "low_vegetation"),
        ("asprs", 4, None),
        ("asprs", 5, "tree"),
        ("asprs", 8, "ground"),
        ("semantickitti", 70, None),
        ("semantickitti", 252, "vehicle_person"),
    ],
)
def test_translation_into_bush(name: str, code: int, bush: str | None) -> None:
    labels = SCHEMES[name].encode(np.array([code])).labels
    label = SCHEMES[name].translate(labels, SCHEMES["bush"])[0]
    assert (None if label == -1 else SCHEMES["bush"].names[label]) == bush


def test_asprs_knows_only_the_standard_codes() -> None:
    _, unknown, _ = SCHEMES["asprs"].encode(np.arange(256, dtype=np.uint8))
    assert set(unknown) == set(range(23, 256))


def test_rellis11_are_the_classes_of_the_papers_table() -> None:
    names = "grass tree vehicle log person bush concrete barrier puddle mud rubble"
    assert SCHEMES["rellis11"].names == tuple(names.split())


def test_rellis_agrees_with_the_data_set() -> None:
    path = FRAMES / "rellis.yaml"
    if not path.exists():
        pytest.skip(f"no {path}")
    names: dict[int, str] = {}
    for line in path.read_text().partition("labels:")[2].partition("color_map")[0].splitlines():
        key, _, value = line.partition(":")
        if value:
            names[int(key)] = value.strip().strip('"')
    assert len(names) == 20
    rellis = SCHEMES["rellis"]
    for code, name in names.items():
        label = rellis.encode(np.array([code])).labels[0]
        assert label == -1 if code in rellis.unlabelled else rellis.names[label] == name
        for scheme in (rellis, SCHEMES["rellis11"]):
            assert scheme.encode(np.array([code])).unknown == {}


@pytest.mark.parametrize("name", ["seq00_000000.label", "seq00_000001.label"])
def test_semantickitti_knows_what_frames_hold(name: str) -> None:
    path = FRAMES / name
    if not path.exists():
        pytest.skip(f"no {path}")
    codes = np.fromfile(path, "<u4") & 0xFFFF
    labels, unknown, invalid = SCHEMES["semantickitti"].encode(codes)
    assert (unknown, invalid) == ({}, 0)
    vegetation = SCHEMES["semantickitti"].names.index("vegetation")
    assert np.count_nonzero(labels == vegetation) == np.count_nonzero(codes == 70) > 0


def test_fit_legacy() -> None:
    codes = np.array([0, 5, 31, 32, 64, 255], np.uint8)
    fitted = fit_legacy(codes)
    assert fitted.dtype == np.uint8
    assert fitted.tolist() == [0, 5, 31, 1, 1, 1]


def test_legacy_loss_names_the_classes_that_have_points() -> None:
    scheme = SCHEMES["bush"]
    counts = np.zeros(scheme.num_classes, np.int64)
    counts[scheme.names.index("tree")] = 5
    assert describe_legacy_loss(scheme, counts) is None
    counts[scheme.names.index("man_made")] = 1
    loss = describe_legacy_loss(scheme, counts)
    assert loss is not None
    assert "man_made (64)" in loss
    assert "vehicle_person" not in loss
    assert describe_legacy_loss(scheme, counts, {"man_made": 6}) is None


def test_load_a_users_scheme(tmp_path: Path) -> None:
    path = tmp_path / "orchard.toml"
    path.write_text(ORCHARD)
    expected = ClassScheme(
        name="orchard",
        classes=(
            ClassInfo(name="soil", codes=(1, 2), color="#a0782d", asprs=2, bush="ground"),
            ClassInfo(name="hedge", codes=(7,)),
        ),
        bush_class="hedge",
    )
    assert load_scheme(path) == load_scheme(str(path)) == expected


def test_the_modules_example_is_valid() -> None:
    import bushseg.labels

    assert bushseg.labels.__doc__ is not None
    scheme = parse_scheme(bushseg.labels.__doc__.partition("TOML file:\n")[2].replace("    ", ""))
    assert scheme.names == ("soil", "hedge")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("codes = [7]", "codes = [2]", "code 2 stands in 'soil' and in 'hedge'"),
        ("codes = [7]", "codes = [-7]", r"codes of class 2 \('hedge'\) is -7; .*greater"),
        ("codes = [7]", "codes = [70000]", r"codes of class 2 \('hedge'\) is 70000; .*65535"),
        ("codes = [7]", 'codes = ["7"]', "valid integer"),
        ("codes = [7]", "", r"codes of class 2 \('hedge'\) is missing"),
        ('name = "hedge"', "", "name of class 2 is missing"),
        ('name = "hedge"', 'name = "Soil"', "two classes are named 'Soil'"),
        ("#a0782d", "brown", r"color of class 1 \('soil'\) is 'brown'"),
        ('bush = "ground"', 'bush = "earth"', r"is 'earth'; input should be 'ground', 'low_veg"),
        ("asprs = 2", "asprs = 999", r"asprs of class 1 \('soil'\) is 999"),
        ("asprs = 2", "aspr = 2", r"aspr of class 1 \('soil'\) is no field"),
        ("unlabelled = [0]", "unlabelled = [1]", "code 1 stands in unlabelled"),
        ('bush_class = "hedge"', 'bush_class = "shrub"', "bush_class 'shrub' is no class"),
        ('name = "orchard"', "name =", "isn't valid TOML"),
        ('name = "orchard"', "x = " + "[" * 50_000, "isn't valid TOML"),
        ('name = "orchard"', "classes = 3", "isn't valid TOML"),
    ],
)
def test_a_malformed_file_is_refused_with_the_field(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in ORCHARD
    path = tmp_path / "orchard.toml"
    path.write_text(ORCHARD.replace(old, new))
    with pytest.raises(SchemeError, match=f"orchard.toml: .*{message}"):
        load_scheme(path)


def test_what_is_no_scheme_at_all(tmp_path: Path) -> None:
    with pytest.raises(SchemeError, match=r"did you mean rellis\?"):
        load_scheme("rellis3d")
    with pytest.raises(SchemeError, match="can't be read"):
        load_scheme(tmp_path / "absent.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SchemeError, match="isn't UTF-8"):
        load_scheme(binary)
    large = tmp_path / "large.toml"
    large.write_bytes(b"#" * 1_000_001)
    with pytest.raises(SchemeError, match="larger than 1 MB"):
        load_scheme(large)
    for text in ("", "classes = 3", "classes = [3]"):
        with pytest.raises(SchemeError, match="class scheme: "):
            parse_scheme(text)
