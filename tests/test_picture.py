"""Which colors a scan's points get; how they are drawn is test_render's."""

import numpy as np
import pytest
from matplotlib.image import imread

from bushseg.errors import DataError, WriteError
from bushseg.io.memory import MemoryReader
from bushseg.labels import load_scheme
from bushseg.picture import class_colors, height_colors, picture
from bushseg.points import PointCloud

BUSH = load_scheme("bush")


@pytest.fixture
def painted(monkeypatch):
    """The colors of each picture, which isn't drawn."""
    found = []
    monkeypatch.setattr(
        "bushseg.picture.render", lambda _xyz, colors, _path, **_: found.append(colors)
    )
    return found


def table(path, header, *rows):
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_class_index_comes_before_codes_and_gray_is_no_class():
    columns = {"class_index": np.array([2, 0, 255], np.uint8)}
    cloud = PointCloud(np.zeros((3, 3)), columns)
    found = class_colors(cloud, MemoryReader(cloud, None), BUSH)
    assert found.dtype == np.uint8
    assert found.tolist() == [BUSH.colors[2].tolist(), BUSH.colors[0].tolist(), [150, 150, 150]]


def test_height_runs_from_blue_to_yellow():
    z = np.linspace(5, 6, 1001)
    found = height_colors(np.stack([z, z, z], axis=1))
    assert found[0].tolist() == [40, 70, 120]
    assert found[-1].tolist() == [250, 235, 150]
    assert (np.diff(found[:, 0].astype(int)) >= 0).all()


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["0 0 0", "51 102 255"], [[0, 0, 0], [51, 102, 255]]),
        (["0 0 0", "13107 26214 65535"], [[0, 0, 0], [51, 102, 255]]),
        (["0 0 0", "0.2 0.4 1"], [[0, 0, 0], [51, 102, 255]]),
        # Dark by itself, the first point must be read on the scale of the second.
        (["0 1 100", "0 0 65535"], [[0, 0, 0], [0, 0, 255]]),
    ],
)
def test_colors_have_one_scale_for_the_whole_scan(tmp_path, painted, monkeypatch, given, expected):
    from bushseg.io.base import ScanReader
    from bushseg.picture import open_scan

    def one_by_one(path):
        reader = open_scan(path)
        chunks = type(reader).chunks
        monkeypatch.setattr(type(reader), "chunks", lambda self: chunks(self, 1))
        assert isinstance(reader, ScanReader)
        return reader

    rows = [f"{number} 0 0 {color}" for number, color in enumerate(given)]
    path = table(
        tmp_path / "scan.csv",
        "x y z red green blue".replace(" ", ","),
        *(row.replace(" ", ",") for row in rows),
    )
    monkeypatch.setattr("bushseg.picture.open_scan", one_by_one)
    picture(path, tmp_path / "out.png", "rgb", BUSH)
    np.testing.assert_allclose(painted[0].astype(int), expected, atol=1)


@pytest.mark.parametrize(("color_by", "words"), [("rgb", "no colors"), ("class", "no labels")])
def test_what_is_not_there_cannot_be_shown(tmp_path, color_by, words):
    path = table(tmp_path / "bare.csv", "x,y,z", "0,0,0", "1,1,1")
    with pytest.raises(DataError, match=words):
        picture(path, tmp_path / "out.png", color_by, BUSH)
    assert not (tmp_path / "out.png").exists()


def test_a_picture_is_drawn_and_not_replaced_unasked(tmp_path):
    path = table(tmp_path / "bare.csv", "x,y,z", "0,0,0", "1,1,1")
    picture(path, tmp_path / "out.png", "height", BUSH)
    assert imread(tmp_path / "out.png").shape[:2] == (900, 1600)
    with pytest.raises(WriteError, match="--overwrite"):
        picture(path, tmp_path / "out.png", "height", BUSH)


def test_points_that_are_not_finite_do_not_stretch_the_heights():
    z = np.linspace(400, 410, 101)
    alone = height_colors(np.column_stack([z, z, z]))
    z = np.append(z, [np.nan] * 50 + [np.inf])
    beside = height_colors(np.column_stack([z, z, z]))
    np.testing.assert_array_equal(beside[:101], alone)
    assert (alone[0] != alone[-1]).all()
    assert height_colors(np.full((1, 3), np.nan)).shape == (1, 3)
