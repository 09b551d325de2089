import numpy as np
import pytest
from scipy.spatial import cKDTree

from bushseg.simulation.materials import Material
from bushseg.simulation.mesh import Surface, box, polyhedron
from bushseg.simulation.scene import CLASS_CODES, Scene
from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.photogrammetry import (
    Seen,
    reconstruct,
    thinned,
    view_directions,
)
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import Terrain

EXACT = {"range_noise": 0, "registration_noise": 0, "color_noise": 0, "dropout": 0, "untextured": 0}
LAWN = polyhedron([(0, 0, 0), (20, 0, 0), (20, 20, 0), (0, 20, 0)], [(0, 1, 2, 3)])


def site(*things):
    scene = Scene()
    scene.add([Surface(LAWN, Material(0.4, (90, 120, 60)))], "ground", instance=False)
    for mesh, name in things:
        scene.add([Surface(mesh, Material(0.6, (200, 100, 50)))], name)
    return Site(scene, Terrain(np.zeros((51, 51)), cell=0.4), np.zeros((1, 3)))


def cloud(made, **settings):
    config = SensorConfig(kind="photogrammetry", **{**EXACT, "point_spacing": 0.1, **settings})
    (returns,) = reconstruct(np.random.default_rng(1), np.random.default_rng(2), made, config)
    return returns


def test_a_lawn_is_flat_and_evenly_covered():
    returns = cloud(site())
    np.testing.assert_allclose(returns.xyz[:, 2], 0, atol=1e-5)
    assert len(returns) == pytest.approx(100 * 400, rel=0.02)
    gaps, _ = cKDTree(returns.xyz).query(
        np.random.default_rng(0).uniform(0.5, 19.5, (500, 3)) * [1, 1, 0]
    )
    assert gaps.max() < 0.15
    assert not returns.intensity.any()
    assert (returns.num_returns == 1).all()


def test_nothing_lies_below_a_roof():
    roof = box((5, 5, 4), (15, 15, 4.3))
    returns = cloud(site((roof, "tree")), scan_angle=20.0)
    within = ((returns.xyz[:, :2] > 7) & (returns.xyz[:, :2] < 13)).all(axis=1)
    assert within.any()
    np.testing.assert_allclose(returns.xyz[within, 2], 4.3, atol=1e-4)
    assert (returns.class_code[within] == CLASS_CODES["tree"]).all()
    assert (returns.instance[within] == 1).all()


def test_walls_are_seen_obliquely_only():
    block = box((6, 6, 0), (14, 14, 5))

    def halfway(**settings):
        z = cloud(site((block, "building")), **settings).xyz[:, 2]
        return ((z > 1) & (z < 4)).sum()

    assert halfway(views=1) == 0
    assert halfway(views=6, scan_angle=30.0) > 200


def test_thin_poles_are_lost():
    pole = box((10, 10, 0), (10.05, 10.05, 3))
    returns = cloud(site((pole, "man-made")), views=1)
    assert (returns.class_code == CLASS_CODES["ground"]).all()


def test_uniform_ground_has_holes():
    whole, holed = len(cloud(site())), len(cloud(site(), untextured=0.2))
    assert holed == pytest.approx(0.8 * whole, rel=0.01)


def test_noise_is_as_asked():
    z = cloud(site(), range_noise=0.02, views=1).xyz[:, 2]
    assert 0.01 < z.std() < 0.022
    z = cloud(site(), registration_noise=0.05, views=1).xyz[:, 2]
    np.testing.assert_allclose(z, z.mean(), atol=1e-5)
    assert abs(z.mean()) > 1e-3


def test_views_go_down_and_as_far_aside_as_asked():
    figures = SensorConfig(kind="photogrammetry", views=9, scan_angle=30.0).figures
    directions = view_directions(np.random.default_rng(0), figures)
    np.testing.assert_array_equal(directions[0], [0, 0, -1])
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    tilts = np.degrees(np.arccos(-directions[1:, 2]))
    assert ((tilts >= 15 - 1e-9) & (tilts <= 30 + 1e-9)).all()
    assert len(np.unique(directions.round(6), axis=0)) == 9


def test_thinning_leaves_means_that_are_what_lies_nearest():
    xyz = np.array([(0.1, 0.1, 0.1), (0.2, 0.1, 0.1), (0.9, 0.1, 0.1), (5.5, 0.5, 0.5)])
    seen = Seen(
        xyz, xyz.astype(np.float32), np.zeros((4, 3), np.float32), np.arange(4, dtype=np.int32)
    )
    left = thinned(seen, 1.0)
    np.testing.assert_allclose(left.xyz, [(0.4, 0.1, 0.1), (5.5, 0.5, 0.5)])
    assert left.part.tolist() == [1, 3]
    assert len(thinned(seen.take(np.zeros(4, bool)), 1.0).xyz) == 0
