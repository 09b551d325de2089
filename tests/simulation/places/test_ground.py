import numpy as np
import pytest

from bushseg.simulation.materials import ASPHALT, LAWN, WATER
from bushseg.simulation.places.ground import BUILT, FREE, PLANT, WAY, Ground
from bushseg.simulation.terrain import Terrain

LINE = np.array([(0, 10), (20, 10)], float)


@pytest.fixture
def ground():
    return Ground.of(Terrain(np.zeros((101, 101)), cell=0.2), 20.0, LAWN)


def test_the_first_free_place_is_taken(ground):
    ground.take(np.array([(5.0, 5.0)]), np.array([2.0]), BUILT)
    candidates = np.array([(5, 6), (5, 9), (15, 15)], float)
    np.testing.assert_array_equal(ground.claim(candidates, 1.5, keep=0.5), (5, 9))
    assert ground.at(ground.taken, np.array([(5, 9.0)]))[0] == BUILT


def test_where_nothing_is_free_the_widest_gap_is_taken(ground):
    ground.take(np.array([(5.0, 5.0)]), np.array([2.0]), BUILT)
    candidates = np.array([(5, 6), (5, 8), (5, 7)], float)
    np.testing.assert_array_equal(ground.claim(candidates, 1.8), (5, 8))
    assert ground.claim(candidates[:1], 1.8) is None


def test_places_keep_off_the_edge(ground):
    np.testing.assert_array_equal(ground.claim(np.array([(-3, 25)], float), 1), (1, 19))


def test_clearance_tells_kinds_apart_and_stays_true(ground):
    ground.clear(LINE, 1.0)
    at = np.array([(10.0, 15.0)])
    assert ground.at(ground.clearance(WAY, WAY), at)[0] == pytest.approx(4, abs=0.3)
    assert ground.at(ground.clearance(BUILT), at)[0] == 20
    ground.take(np.array([(10.0, 17.0)]), np.array([1.0]), BUILT)
    assert ground.at(ground.clearance(BUILT), at)[0] == pytest.approx(1, abs=0.3)
    ground.take(np.array([(10.0, 10.0)]), np.array([1.0]), PLANT)
    assert ground.at(ground.taken, np.array([(10.0, 10.0)]))[0] == WAY


def test_a_graded_way_is_level_across_and_leaves_the_rest(ground):
    at = ground.corners()
    ground.terrain.heights[:] = (0.3 * at[:, 1]).reshape(101, 101)
    before = ground.terrain.heights.copy()
    ground.grade(LINE, 2.0, shoulder=1.0, lift=0.5)
    across = ground.terrain.height(np.array([(10, 8.5), (10, 10), (10, 11.5)], float))
    np.testing.assert_allclose(across, 3.5, atol=0.05)
    far = np.abs(at[:, 1].reshape(101, 101) - 10) > 3.01
    np.testing.assert_array_equal(ground.terrain.heights[far], before[far])


def test_trench_bank_and_pad(ground):
    ground.trench(LINE, 0.5, 0.4)
    assert ground.terrain.height(np.array([(10.0, 10.0)]))[0] == pytest.approx(-0.4)
    ground.bank(LINE + np.array((0, 5)), 1.0, 0.6)
    assert ground.terrain.height(np.array([(10.0, 15.0)]))[0] == pytest.approx(0.6)
    ground.level(np.array([10.0, 15.0]), 2.0)
    pad = ground.terrain.height(np.array([(9, 14), (11, 16), (10, 13.2)], float))
    np.testing.assert_allclose(pad, 0.6, atol=1e-9)


def test_a_puddle_is_level_water(ground):
    ground.terrain.heights[:] += np.random.default_rng(0).normal(0, 0.05, (101, 101))
    ground.puddle(np.array([10.0, 10.0]), np.array([2.0, 1.0]), 0.5, WATER)
    wet = [surface for surface in ground.surfaces() if surface.material is WATER]
    (surface,) = wet
    assert np.ptp(surface.mesh.vertices[surface.mesh.triangles.ravel(), 2]) == 0
    area = len(surface.mesh.triangles) * 0.02
    assert area == pytest.approx(np.pi * 2, rel=0.25)


def test_surfaces_hold_each_triangle_once(ground):
    ground.lay(ground.within(LINE, 2.0), ASPHALT)
    surfaces = ground.surfaces()
    triangles = np.concatenate([mesh.triangles for mesh, _ in surfaces])
    assert [material for _, material in surfaces] == [LAWN, ASPHALT]
    assert len(triangles) == len(ground.terrain.mesh().triangles)
    assert len(np.unique(triangles, axis=0)) == len(triangles)
    paved = surfaces[1].mesh
    y = paved.vertices[paved.triangles.ravel(), 1]
    assert 7.7 < y.min() < y.max() < 12.3


def test_all_is_free_at_first(ground):
    assert (ground.taken == FREE).all()
