import numpy as np
import pytest

from bushseg.simulation.structures.barriers import BARRIERS
from bushseg.simulation.structures.buildings import BUILDING_FORMS, FOOTING, building
from bushseg.simulation.structures.earth import heap, rock
from bushseg.simulation.structures.furniture import FURNITURE
from bushseg.simulation.structures.people import person
from bushseg.simulation.structures.poles import lamp_post, marker, power_pole, sign, wires
from bushseg.simulation.structures.vehicles import VEHICLES
from bushseg.simulation.terrain import Terrain

SMALL = {**FURNITURE, "person": person, "sign": sign, "marker": marker, "lamp": lamp_post}


def vertices(model):
    for mesh, _ in model:
        assert len(mesh.triangles)
        assert mesh.triangles.max() < len(mesh.vertices)
    xyz = np.concatenate([mesh.vertices[mesh.triangles.ravel()] for mesh, _ in model])
    assert np.isfinite(xyz).all()
    return xyz


@pytest.mark.parametrize("form", BUILDING_FORMS)
@pytest.mark.parametrize("seed", range(3))
def test_buildings_have_the_size_they_say(form, seed):
    house = building(np.random.default_rng(seed), form)
    xyz = vertices(house.model)
    assert xyz[:, 2].min() == pytest.approx(-FOOTING)
    assert 1.4 < xyz[:, 2].max() < 12
    assert house.length <= np.ptp(xyz[:, 0]) < house.length + 1
    assert house.width <= np.ptp(xyz[:, 1]) < house.width + 1


def test_a_building_is_no_longer_than_asked():
    assert building(np.random.default_rng(0), "barn", largest=5).length == 5


@pytest.mark.parametrize("name", VEHICLES)
def test_vehicles_stand_on_their_wheels(name):
    xyz = vertices(VEHICLES[name](np.random.default_rng(0)))
    assert xyz[:, 2].min() == pytest.approx(0, abs=0.01)
    assert 3 < np.ptp(xyz[:, 0]) < 7
    assert 1.5 < np.ptp(xyz[:, 1]) < 2.6
    assert 1.3 < xyz[:, 2].max() < 3


@pytest.mark.parametrize("name", SMALL)
def test_small_things_are_of_their_size(name):
    for seed in range(4):
        xyz = vertices(SMALL[name](np.random.default_rng(seed)))
        assert -0.4 < xyz[:, 2].min() < 0.05
        assert xyz[:, 2].max() < 9
        assert np.abs(xyz[:, :2]).max() < 3.2


@pytest.mark.parametrize("kind", BARRIERS)
def test_barriers_follow_the_ground(kind):
    slope = Terrain(0.3 * np.arange(51)[:, None] * np.ones(51) * 0.4, cell=0.4)
    start, end = np.array([2.0, 5.0]), np.array([12.0, 8.0])
    xyz = vertices(BARRIERS[kind](slope, start, end, 1.2)).astype(float)
    above = xyz[:, 2] - slope.height(xyz[:, :2])
    assert 1.0 < above.max() < 1.75
    assert above.min() > -1
    assert np.ptp(xyz[:, 0]) == pytest.approx(10, abs=0.6)


def test_wires_hang_between_their_poles():
    tops = np.array([(0, 0, 8), (20, 0, 9)], float)
    xyz = vertices(wires(tops, sag=0.5))
    assert xyz[:, 2].max() == pytest.approx(9, abs=0.05)
    middle = xyz[np.abs(xyz[:, 0] - 10) < 1.5]
    assert middle[:, 2].mean() == pytest.approx(8.0, abs=0.1)
    assert vertices(power_pole(8))[:, 2].max() == 8


def test_rocks_and_heaps_lie_in_the_ground():
    for seed in range(4):
        stone = vertices(rock(np.random.default_rng(seed), 1.0))
        assert -0.6 < stone[:, 2].min() < 0 < stone[:, 2].max() < 1
        pile = vertices(heap(np.random.default_rng(seed), 2.0))
        assert -0.2 < pile[:, 2].min() < 0
        assert 0.8 < pile[:, 2].max() < 1.6


def struck(mesh, x, z):
    """Whether a ray along y at (x, z) meets a mesh: its place in triangles seen from the side."""
    a, b, c = mesh.vertices[mesh.triangles.astype(int)][:, :, ::2].astype(float).transpose(1, 0, 2)
    at = np.array([x, z])
    way = [(q - p, at - p) for p, q in ((a, b), (b, c), (c, a))]
    turns = np.array([u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] for u, v in way])
    return bool(((turns > 0).all(axis=0) | (turns < 0).all(axis=0)).any())


@pytest.mark.parametrize("seed", range(3))
def test_a_car_is_seen_through_its_windows(seed):
    shell = VEHICLES["estate"](np.random.default_rng(seed), 1.0)[0].mesh
    half, high = np.abs(shell.vertices[:, 0]).max(), shell.vertices[:, 2].max()
    assert struck(shell, 0.1 * half, 0.5 * high)  # a door
    assert struck(shell, -0.12 * half, 0.8 * high)  # a pillar
    assert not struck(shell, 0.0, 0.8 * high)  # a window
    assert not struck(shell, 0.0, 0.1)  # below the car
