import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.image import imread

from bushseg.errors import DataError
from bushseg.render import BACKGROUND, draw, render

RED, BLUE, GREEN = (255, 0, 0), (0, 0, 255), (0, 255, 0)


def picture(xyz, colors, **settings):
    defaults = {
        "view": (0.0, 90.0),
        "width": 61,  # odd: the middle is no border between pixels
        "height": 41,
        "field_of_view": 0.0,
        "point_size": 1,
        "lighting": 0.0,
    }
    return draw(np.array(xyz, float), np.array(colors, np.uint8), **{**defaults, **settings})


def colors_of(image):
    return {tuple(color) for color in image.reshape(-1, 3).tolist()}


@pytest.mark.parametrize("field_of_view", [0.0, 1.0])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_nearer_point_hides_the_farther(field_of_view, order):
    xyz = np.array([(0, 0, 0), (0, 0, 5)], float)[list(order)]
    colors = np.array([RED, BLUE])[list(order)]
    above = picture(xyz, colors, field_of_view=field_of_view, point_size=3)
    below = picture(xyz, colors, field_of_view=field_of_view, point_size=3, view=(0.0, -90.0))
    assert colors_of(above) == {BLUE, BACKGROUND}
    assert colors_of(below) == {RED, BACKGROUND}


def test_view_from_the_side_keeps_up_up():
    image = picture([(0, 0, 0), (0, 0, 5)], [RED, BLUE], view=(0.0, 0.0), point_size=3)
    rows = {c: np.argwhere((image == c).all(axis=2))[:, 0].mean() for c in (RED, BLUE)}
    assert rows[BLUE] < rows[RED]


def test_view_from_x_has_y_to_the_right():
    image = picture([(0, 0, 0), (0, 5, 0)], [RED, BLUE], view=(0.0, 0.0), point_size=3)
    columns = {c: np.argwhere((image == c).all(axis=2))[:, 1].mean() for c in (RED, BLUE)}
    assert columns[RED] < columns[BLUE]


coordinates = st.lists(st.tuples(*[st.floats(-1e3, 1e3)] * 3), min_size=1, max_size=30, unique=True)


@settings(max_examples=50, deadline=None)
@given(
    xyz=coordinates,
    view=st.tuples(st.floats(-360, 360), st.floats(-90, 90)),
    field_of_view=st.sampled_from([0.0, 35.0, 90.0]),
)
def test_every_cloud_fits_into_its_picture(xyz, view, field_of_view):
    image = picture(
        xyz, [RED] * len(xyz), view=view, field_of_view=field_of_view, width=50, height=50
    )
    drawn = np.argwhere((image == RED).all(axis=2))
    assert len(drawn)
    if len(xyz) > 1:
        # The cloud touches the margins, and nothing is cut off.
        assert drawn.min() >= 0
        assert np.ptp(drawn, axis=0).max() >= 44 or np.ptp(np.array(xyz), axis=0).max() < 1e-3


def test_points_that_are_not_finite_are_left_out():
    image = picture([(0, 0, 0), (np.nan, 0, 0), (0, np.inf, 0)], [RED, BLUE, GREEN])
    assert colors_of(image) == {RED, BACKGROUND}


def test_eye_dome_lighting_darkens_behind_an_edge():
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
    z = np.where(x < 20, 0.0, 6.0)
    xyz = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    white = np.full(xyz.shape, 255)
    lit = picture(xyz, white, width=40, height=40, point_size=2, lighting=1.0).min(axis=2)
    step = lit[15:25]
    assert step.min() < 150
    assert np.median(step) == 255


def test_writes_a_png_of_the_size_asked_for(tmp_path):
    path = tmp_path / "pictures" / "site.png"
    rng = np.random.default_rng(0)
    render(rng.normal(size=(500, 3)), np.full((500, 3), 80, np.uint8), path, width=64, height=48)
    assert imread(path).shape[:2] == (48, 64)
    assert [p.name for p in path.parent.iterdir()] == ["site.png"]


def test_refuses_what_can_not_be_drawn():
    with pytest.raises(DataError, match="nothing to draw"):
        picture([(np.nan, 0, 0)], [RED])
    with pytest.raises(ValueError, match="expected"):
        picture([(0, 0, 0)], [RED, RED])
    with pytest.raises(ValueError, match="width"):
        picture([(0, 0, 0)], [RED], width=0)
