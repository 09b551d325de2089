import numpy as np
import pytest

from bushseg.io.table import PADDING, attribute_dtypes, find_coordinates, find_label


@pytest.mark.parametrize(
    ("names", "label"),
    [
        (["intensity"], None),
        (["classification", "label"], "label"),
        (["scalar_Classification", "red"], "scalar_Classification"),
        (["scalar_Label"], "scalar_Label"),
        (["Class"], "Class"),
        (["semantic"], "semantic"),
        (["Label", "label"], "Label"),
        (["labelled_by", "classifier"], None),
        ([], None),
    ],
)
def test_find_label(names: list[str], label: str | None) -> None:
    assert find_label(names) == label


@pytest.mark.parametrize(
    ("names", "coordinates"),
    [
        (["z", "y", "x"], ("x", "y", "z")),
        (["X", "x", "y", "z"], ("x", "y", "z")),
        (["X", "Y", "Z"], ("X", "Y", "Z")),
        (["Northing", "Easting", "Height"], ("Easting", "Northing", "Height")),
        (["easting", "northing", "height", "X", "Y", "Z"], ("easting", "northing", "height")),
        (["x", "y"], None),
    ],
)
def test_find_coordinates(names: list[str], coordinates: tuple[str, ...] | None) -> None:
    assert find_coordinates(names) == coordinates


def test_attributes_are_native_and_without_padding() -> None:
    dtype = np.dtype(
        [("x", ">f4"), ("y", ">f4"), ("z", ">f4"), ("t", ">u2"), (f"{PADDING}4", "u1")]
    )
    attributes = attribute_dtypes(dtype, ("x", "y", "z"))
    assert attributes == {"t": np.dtype("u2")}
    assert attributes["t"].isnative
