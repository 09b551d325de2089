"""Features: found by any name, brought to one scale, absent where a scan has nothing to say."""

import numpy as np
import pytest

from bushseg.features import FEATURES, normalize, source_columns, source_values
from bushseg.points import PointCloud

NO_HEIGHT = np.zeros(4, dtype=np.float32)
RAMP = np.array([0.0, 0.25, 0.5, 1.0])


def cloud(**attributes: np.ndarray) -> PointCloud:
    return PointCloud(np.zeros((len(next(iter(attributes.values()))), 3)), attributes)


def colors(scale: float) -> dict[str, np.ndarray]:
    ramp = (RAMP * scale).astype(np.float32)
    return {"red": ramp, "green": ramp[::-1].copy(), "blue": ramp}


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("red", "green", "blue"), {"red": "red", "green": "green", "blue": "blue"}),
        (("Red", "Green", "Blue"), {"red": "Red", "green": "Green", "blue": "Blue"}),
        (("r", "g", "b", "i"), {"red": "r", "green": "g", "blue": "b", "intensity": "i"}),
        (
            ("diffuse_red", "diffuse_green", "diffuse_blue"),
            {"red": "diffuse_red", "green": "diffuse_green", "blue": "diffuse_blue"},
        ),
        (
            ("colorRed", "colorGreen", "colorBlue", "Intensity"),
            {
                "red": "colorRed",
                "green": "colorGreen",
                "blue": "colorBlue",
                "intensity": "Intensity",
            },
        ),
        (("scalar_Intensity",), {"intensity": "scalar_Intensity"}),
        (("reflectance", "intensity"), {"intensity": "intensity"}),
        (("Reflectance",), {"intensity": "Reflectance"}),
        (("rgb",), {"packed": "rgb"}),
        (("rgba", "red"), {"packed": "rgba"}),
        (("rgb", "red", "green", "blue"), {"red": "red", "green": "green", "blue": "blue"}),
        (("red", "green", "nir"), {}),
        ((), {}),
    ],
)
def test_columns_are_found_by_any_spelling(
    names: tuple[str, ...], expected: dict[str, str]
) -> None:
    assert source_columns(dict.fromkeys(names)) == expected


@pytest.mark.parametrize("scale", [1.0, 255.0, 65535.0])
def test_colors_of_any_depth_become_unit_range(scale: float) -> None:
    rgb = normalize(colors(scale), NO_HEIGHT)["rgb"]
    assert rgb.dtype == np.float32
    np.testing.assert_allclose(rgb[:, 0], RAMP * 2 - 1, atol=1e-6)
    np.testing.assert_allclose(rgb[:, 1], RAMP[::-1] * 2 - 1, atol=1e-6)


@pytest.mark.parametrize("constant", [(0, 0, 0), (255, 255, 255), (10, 20, 30)])
def test_a_constant_color_counts_as_absent(constant: tuple[int, int, int]) -> None:
    values = {
        name: np.full(4, value, np.float32)
        for name, value in zip(("red", "green", "blue"), constant, strict=True)
    }
    assert list(normalize(values, NO_HEIGHT)) == ["height"]


def test_one_channel_that_varies_is_color() -> None:
    values = {name: np.zeros(4, np.float32) for name in ("red", "green", "blue")}
    values["blue"] = np.array([0, 0, 0, 200], np.float32)
    assert normalize(values, NO_HEIGHT)["rgb"][3].tolist() == pytest.approx([-1, -1, 400 / 255 - 1])


def test_intensity_is_centered_on_the_median_and_clipped() -> None:
    intensity = np.arange(101, dtype=np.float32) * 40 + 7
    intensity[-1] = 1e6
    scaled = normalize({"intensity": intensity}, np.zeros(101, np.float32))["intensity"]
    assert scaled.shape == (101, 1)
    np.testing.assert_allclose(scaled[[10, 50, 90], 0], [-0.5, 0, 0.5], atol=1e-6)
    assert scaled[-1, 0] == 2


def test_a_constant_intensity_counts_as_absent() -> None:
    assert list(normalize({"intensity": np.full(4, 9, np.float32)}, NO_HEIGHT)) == ["height"]


def test_features_come_in_the_networks_order_and_width() -> None:
    values = {"intensity": np.arange(4, dtype=np.float32), **colors(255.0)}
    features = normalize(values, np.array([0, 5, 10, -5], np.float32))
    assert list(features) == list(FEATURES)
    assert {name: columns.shape[1] for name, columns in features.items()} == FEATURES
    assert features["height"][:, 0].tolist() == [0, 1, 2, -1]


def test_no_points_have_features_without_rows() -> None:
    empty = np.empty(0, np.float32)
    values = dict.fromkeys(("red", "green", "blue", "intensity"), empty)
    assert {name: len(column) for name, column in normalize(values, empty).items()} == {"height": 0}


@pytest.mark.parametrize("dtype", [np.float32, np.uint32, np.int32, np.int64])
def test_packed_colors_are_unpacked(dtype: type) -> None:
    bits = np.array([0x010203, 0xFFFFFF, 0x00FF00, 0], dtype=np.uint32)
    packed = bits.view(np.float32) if dtype is np.float32 else bits.astype(dtype)
    values = source_values(cloud(rgb=packed), {"packed": "rgb"})
    assert values["red"].tolist() == [1, 255, 0, 0]
    assert values["green"].tolist() == [2, 255, 255, 0]
    assert values["blue"].tolist() == [3, 255, 0, 0]


def test_alpha_is_no_color() -> None:
    values = source_values(cloud(rgba=np.array([0xFF010203], np.uint32)), {"packed": "rgba"})
    assert [values[name].tolist() for name in ("red", "green", "blue")] == [[1], [2], [3]]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_values_that_are_not_finite_become_zero(dtype: type) -> None:
    column = np.array([np.nan, np.inf, -np.inf, 3], dtype=dtype)
    values = source_values(cloud(Intensity=column), {"intensity": "Intensity"})
    assert values["intensity"].tolist() == [0, 0, 0, 3]
    assert values["intensity"].dtype == np.float32


def test_values_beyond_float32_become_zero_without_a_warning() -> None:
    values = source_values(cloud(i=np.array([1e300, -1e300, 2.0])), {"intensity": "i"})
    assert values["intensity"].tolist() == [0, 0, 2]
