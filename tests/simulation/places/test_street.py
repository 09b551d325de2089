import numpy as np
import pytest

from bushseg.simulation import SimulateConfig
from bushseg.simulation.places.config import PlaceConfig
from bushseg.simulation.places.nursery import Nursery
from bushseg.simulation.plants import PlantsConfig
from bushseg.simulation.scene import CLASS_CODES
from bushseg.simulation.site import make_site


def street(**amounts):
    place = dict(PlaceConfig.bare(**amounts))
    config = SimulateConfig.model_validate(
        {"place": "street", "plants": {"detail": 0.05}, "places": {"street": place}}
    )
    return make_site(np.random.default_rng(1), config)


def things(site, name):
    return {p.instance for p in site.scene.parts if p.class_code == CLASS_CODES[name]}


def vertices(site, name):
    parts = [p.mesh.vertices for p in site.scene.parts if p.class_code == CLASS_CODES[name]]
    return np.concatenate(parts).astype(float)


def test_cars_are_parked_nose_to_tail_and_none_overlap():
    site = street(parked=(2, 2))
    cars = [
        np.concatenate([p.mesh.vertices for p in site.scene.parts if p.instance == thing])
        for thing in things(site, "vehicle or person")
    ]
    assert 8 <= len(cars) <= 16  # 40 m, both sides, about 5 m each
    middles = np.array([car.mean(axis=0)[:2] for car in cars])
    apart = np.linalg.norm(middles[:, None] - middles, axis=2)
    nearest = (apart + 99 * np.eye(len(cars))).min(axis=1)
    assert 3.5 < nearest.min() < 6
    assert not things(street(parked=(0, 0)), "vehicle or person")


def test_plants_grow_by_the_walls():
    site = street(buildings=(4, 4), front_plants=(1, 1))
    assert len(things(site, "building")) >= 2
    bush = vertices(site, "bush")[::20]
    near = 0
    for thing in things(site, "building"):
        parts = [p.mesh.vertices for p in site.scene.parts if p.instance == thing]
        wall = np.concatenate(parts)[:, :2].astype(float)
        low, high = wall.min(axis=0) - 1, wall.max(axis=0) + 1
        near += ((bush[:, :2] > low) & (bush[:, :2] < high)).all(axis=1).sum()
    assert near > 0.1 * len(bush)
    assert not things(street(buildings=(4, 4)), "bush")


@pytest.mark.parametrize("seed", range(3))
def test_stands_have_bare_stems(seed):
    wanted = {"undergrowth": 0.0, "vigor": 1.0, "bare_stems": 1.0}
    wanted |= dict.fromkeys(("trees", "shrubs", "saplings", "hedges"), 1.0)
    plants = PlantsConfig(tree_forms={"round": 1}, tree_leafless=0, tree_ivy=0, detail=0.2)
    tree = Nursery(np.random.default_rng(seed), plants, wanted, 20.0).tree()
    leaves = tree.model[1].mesh.vertices[:, 2]
    assert np.quantile(leaves, 0.02) > 0.2 * tree.height
