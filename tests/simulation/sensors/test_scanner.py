import numpy as np
import pytest

from bushseg.simulation.materials import Material
from bushseg.simulation.mesh import Surface, polyhedron
from bushseg.simulation.scene import CLASS_CODES, Scene
from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.rays import PULSE_RATE, Rays
from bushseg.simulation.sensors.scanner import scan

EXACT = {
    "range_noise": 0,
    "intensity_noise": 0,
    "angular_noise": 0,
    "color_noise": 0,
    "dropout": 0,
    "sub_rays": 1,
    "split": "all",
    "reach": 1e6,
    "intensity": "corrected",
}


def screen(x, half=1.0, reflectance=0.5, left=None):
    """A square across the x axis, from y = `left` (or -half) on."""
    low = -half if left is None else left
    corners = [(x, low, -half), (x, half, -half), (x, half, half), (x, low, half)]
    return [Surface(polyhedron(corners, [(0, 1, 2, 3)]), Material(reflectance, (10, 20, 30)))]


def rays(*directions, station=1, first=0):
    unit = np.array(directions, float)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return Rays.exact(np.zeros_like(unit), unit, station, first)


def cast(scene, batch, **settings):
    config = SensorConfig(**{**EXACT, **settings})
    (returns,) = scan(np.random.default_rng(0), scene, iter([batch]), config)
    return returns


def plates(*surfaces):
    scene = Scene()
    for model, name in surfaces:
        scene.add(model, name)
    return scene


def test_one_ray_on_a_known_square():
    scene = plates((screen(4.0), "bush"))
    returns = cast(scene, rays((1, 0, 0), (-1, 0, 0), station=2, first=100))
    np.testing.assert_allclose(returns.xyz, [(4, 0, 0)], atol=1e-6)
    assert returns.class_code.tolist() == [4]
    assert returns.instance.tolist() == [1]
    assert returns.intensity.tolist() == [round(0.5 * 65535)]
    assert returns.ray.tolist() == [0]
    assert returns.time.tolist() == [100 / PULSE_RATE]
    assert (returns.return_number.tolist(), returns.num_returns.tolist()) == ([1], [1])
    assert (returns.station, returns.num_rays, len(returns)) == (2, 2, 1)


def test_intensity_falls_with_the_cosine_of_incidence():
    scene = plates((screen(4.0, half=20), "man-made"))
    returns = cast(scene, rays((0.5, np.sqrt(0.75), 0)))
    assert np.linalg.norm(returns.xyz) == pytest.approx(8, abs=1e-5)
    assert returns.intensity[0] == pytest.approx(0.25 * 65535, abs=1)


def test_raw_intensity_falls_with_the_square_of_the_range_from_saturation_on():
    scene = plates((screen(8.0), "man-made"))
    settings = {"intensity": "raw", "reach": 20.0}
    assert cast(scene, rays((1, 0, 0)), **settings).intensity[0] == pytest.approx(65535 / 8, abs=1)
    near = plates((screen(3.0), "man-made"))
    assert cast(near, rays((1, 0, 0)), **settings).intensity[0] == pytest.approx(65535 / 2, abs=1)


def test_the_nearer_thing_hides_the_farther():
    scene = plates((screen(6.0, half=9), "building"), (screen(3.0), "tree"))
    scene.add(screen(9.0), "ground", instance=False)
    returns = cast(scene, rays((1, 0, 0), (1, 1, 0)))
    np.testing.assert_array_equal(
        returns.class_code, (CLASS_CODES["tree"], CLASS_CODES["building"])
    )
    np.testing.assert_array_equal(returns.instance, (2, 1))


def test_two_plates_in_one_beam_are_two_returns():
    scene = plates((screen(10.0, left=0.0), "bush"), (screen(12.0, half=5), "building"))
    wide = {"sub_rays": 7, "divergence": 20.0, "range_resolution": 0.5}
    both = cast(scene, rays((1, 0, 0)), **wide, echo="all", max_returns=3)
    np.testing.assert_allclose(both.xyz, [(10, 0, 0), (12, 0, 0)], atol=1e-5)
    assert both.class_code.tolist() == [4, 6]
    assert both.return_number.tolist() == [1, 2]
    assert both.num_returns.tolist() == [2, 2]
    # The middle is on the edge; of the ring, three are before it and three behind.
    assert both.intensity.sum() == pytest.approx(0.5 * 65535, abs=2)
    last = cast(scene, rays((1, 0, 0)), **wide, echo="last")
    assert (last.class_code.tolist(), last.num_returns.tolist()) == ([6], [1])
    one = cast(scene, rays((1, 0, 0)), **wide, echo="all", max_returns=1)
    assert (one.class_code.tolist(), one.num_returns.tolist()) == ([4], [1])


def test_an_edge_within_the_resolution_is_one_return_in_between():
    scene = plates((screen(10.0, left=0.01), "bush"), (screen(10.3, half=5), "building"))
    wide = {"sub_rays": 7, "divergence": 20.0, "range_resolution": 0.5}
    mixed = cast(scene, rays((1, 0, 0)), **wide, echo="all", max_returns=3)
    assert len(mixed) == 1
    assert 10.05 < mixed.xyz[0, 0] < 10.25
    assert mixed.class_code.tolist() == [6]


def test_a_light_return_stops_at_the_reach():
    scene = plates((screen(20.0, reflectance=0.4), "bush"))
    many = rays(*[(1, 0, 0)] * 4000)
    # Four times the reflectance is seen from twice as far.
    assert len(cast(scene, many, reach=10.0)) == pytest.approx(2000, rel=0.1)
    assert len(cast(scene, many, reach=40.0)) == 4000
    assert len(cast(scene, many, reach=4.0)) == 0


def test_ground_is_no_instance():
    scene = Scene()
    scene.add(screen(3.0), "ground", instance=False)
    assert cast(scene, rays((1, 0, 0))).instance.tolist() == [0]


def test_returns_beyond_the_limits_are_lost():
    scene = plates((screen(4.0), "bush"))
    assert len(cast(scene, rays((1, 0, 0)), max_range=3.9)) == 0
    assert len(cast(scene, rays((1, 0, 0)), min_range=4.1)) == 0


def test_noise_is_along_the_ray_and_as_large_as_asked():
    scene = plates((screen(4.0), "bush"))
    many = rays(*[(1, 0, 0)] * 20_000)
    returns = cast(scene, many, range_noise=0.02, dropout=0.25, noise_range=1e6)
    assert len(returns) == pytest.approx(15_000, rel=0.03)
    assert returns.xyz[:, 0].std() == pytest.approx(0.02, rel=0.05)
    assert returns.xyz[:, 0].mean() == pytest.approx(4, abs=0.001)
    np.testing.assert_allclose(returns.xyz[:, 1:], 0, atol=1e-12)
    growing = cast(scene, many, range_noise=0.02, noise_range=4.0)
    assert growing.xyz[:, 0].std() == pytest.approx(0.02 * np.sqrt(2), rel=0.05)


def test_a_deflected_ray_is_reported_where_it_was_aimed():
    scene = plates((screen(4.0), "bush"))
    returns = cast(scene, rays(*[(1, 0, 0)] * 500), angular_noise=1.0)
    np.testing.assert_allclose(returns.xyz[:, 1:], 0, atol=1e-12)
    assert returns.xyz[:, 0].max() > 4.0005  # the slant is longer


def test_a_beam_from_high_up_is_as_exact():
    ground = Surface(
        polyhedron([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2, 3)]),
        Material(0.5, (90, 90, 90)),
    )
    scene = Scene()
    scene.add([ground], "ground", instance=False)
    down = np.array([(0.1, 0.2, -1.0)])
    down /= np.linalg.norm(down)
    batch = Rays.exact(np.array([(-150.0, -300.0, 1500.0)]), down, 1, 0)
    returns = cast(scene, batch, max_range=4000.0)
    np.testing.assert_allclose(returns.xyz, [(0, 0, 0)], atol=5e-4)


def test_shadows_are_darker():
    def plate(z, half):
        corners = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
        return [Surface(polyhedron(corners, [(0, 1, 2, 3)]), Material(0.5, (200, 200, 200)))]

    scene = plates((plate(-2.0, 50.0), "ground"), (plate(3.0, 20.0), "building"))
    down = rays((0, 0, -1))
    shade = cast(scene, down).color
    sun = cast(scene, down, shadows=False).color
    assert (shade.astype(int) < sun).all()


def test_no_color_where_none_is_wanted():
    scene = plates((screen(4.0), "bush"))
    assert not cast(scene, rays((1, 0, 0)), color=False).color.any()


def test_an_empty_scene_is_refused():
    with pytest.raises(ValueError, match="empty"):
        cast(Scene(), rays((1, 0, 0)))


def test_an_unknown_class_is_refused():
    with pytest.raises(KeyError):
        Scene().add(screen(1.0), "shrubbery")
