import numpy as np
import pytest

from bushseg.simulation import SimulateConfig
from bushseg.simulation.materials import Material
from bushseg.simulation.mesh import Surface, polyhedron
from bushseg.simulation.scanner import scan
from bushseg.simulation.scene import CLASS_CODES, Scene
from bushseg.simulation.sensors import PULSE_RATE, Rays

EXACT = {"range_noise": 0, "intensity_noise": 0, "color_noise": 0, "dropout": 0}


def screen(x, half=1.0, reflectance=0.5):
    """A square across the x axis."""
    corners = [(x, -half, -half), (x, half, -half), (x, half, half), (x, -half, half)]
    return [Surface(polyhedron(corners, [(0, 1, 2, 3)]), Material(reflectance, (10, 20, 30)))]


def rays(*directions, station=1, first=0):
    unit = np.array(directions, float)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return Rays(np.zeros_like(unit), unit, station, first)


def cast(scene, batch, **settings):
    config = SimulateConfig(**{**EXACT, **settings})
    (returns,) = scan(np.random.default_rng(0), scene, iter([batch]), config)
    return returns


def test_one_ray_on_a_known_square():
    scene = Scene()
    scene.add(screen(4.0), "bush")
    returns = cast(scene, rays((1, 0, 0), (-1, 0, 0), station=2, first=100))
    np.testing.assert_allclose(returns.xyz, [(4, 0, 0)], atol=1e-6)
    assert returns.class_code.tolist() == [4]
    assert returns.instance.tolist() == [1]
    assert returns.intensity.tolist() == [round(0.5 * 65535)]
    assert returns.ray.tolist() == [0]
    assert returns.time.tolist() == [100 / PULSE_RATE]
    assert (returns.station, returns.num_rays, len(returns)) == (2, 2, 1)


def test_intensity_falls_with_the_cosine_of_incidence():
    scene = Scene()
    scene.add(screen(4.0, half=20), "man-made")
    returns = cast(scene, rays((0.5, np.sqrt(0.75), 0)))
    assert np.linalg.norm(returns.xyz) == pytest.approx(8, abs=1e-5)
    assert returns.intensity[0] == pytest.approx(0.25 * 65535, abs=1)


def test_the_nearer_thing_hides_the_farther():
    scene = Scene()
    scene.add(screen(6.0, half=9), "building")
    scene.add(screen(3.0), "tree")
    scene.add(screen(9.0), "ground", instance=False)
    returns = cast(scene, rays((1, 0, 0), (1, 1, 0)))
    np.testing.assert_array_equal(
        returns.class_code, (CLASS_CODES["tree"], CLASS_CODES["building"])
    )
    np.testing.assert_array_equal(returns.instance, (2, 1))


def test_ground_is_no_instance():
    scene = Scene()
    scene.add(screen(3.0), "ground", instance=False)
    assert cast(scene, rays((1, 0, 0))).instance.tolist() == [0]


def test_returns_beyond_the_limits_are_lost():
    scene = Scene()
    scene.add(screen(4.0), "bush")
    assert len(cast(scene, rays((1, 0, 0)), max_range=3.9)) == 0
    assert len(cast(scene, rays((1, 0, 0)), min_range=4.1)) == 0


def test_noise_is_along_the_ray_and_as_large_as_asked():
    scene = Scene()
    scene.add(screen(4.0), "bush")
    returns = cast(scene, rays(*[(1, 0, 0)] * 20_000), range_noise=0.02, dropout=0.25)
    assert len(returns) == pytest.approx(15_000, rel=0.03)
    assert returns.xyz[:, 0].std() == pytest.approx(0.02, rel=0.05)
    assert returns.xyz[:, 0].mean() == pytest.approx(4, abs=0.001)
    np.testing.assert_allclose(returns.xyz[:, 1:], 0, atol=1e-12)


def test_an_empty_scene_is_refused():
    with pytest.raises(ValueError, match="empty"):
        cast(Scene(), rays((1, 0, 0)))


def test_an_unknown_class_is_refused():
    with pytest.raises(KeyError):
        Scene().add(screen(1.0), "shrubbery")
