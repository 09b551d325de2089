from collections import Counter

import numpy as np
import pytest

from bushseg.simulation import SimulateConfig
from bushseg.simulation.places.config import DEFAULTS, PLACE_NAMES, PlaceConfig
from bushseg.simulation.places.lines import nearest
from bushseg.simulation.scene import CLASS_CODES
from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.site import LAYOUTS, make_site

CHEAP = {"detail": 0.1}
PLANTED = {"ground", "low vegetation", "bush", "tree"}
EXPECTED = {
    "garden": {"building", "man-made"},
    "park": {"man-made", "vehicle or person"},
    "road": {"man-made", "vehicle or person"},
    "street": {"building", "man-made", "vehicle or person"},
    "village": {"building", "man-made", "vehicle or person"},
    "yard": {"building", "man-made", "vehicle or person"},
}


def site_of(place, seed=0, **settings):
    config = SimulateConfig.model_validate({"place": place, "plants": CHEAP, **settings})
    return make_site(np.random.default_rng(seed), config)


def classes(site):
    names = {code: name for name, code in CLASS_CODES.items()}
    return {names[part.class_code] for part in site.scene.parts}


@pytest.fixture(scope="module", params=PLACE_NAMES)
def site(request):
    return site_of(request.param)


def test_every_place_has_a_layout_and_defaults():
    assert set(LAYOUTS) == set(PLACE_NAMES) == set(DEFAULTS)


def test_a_place_holds_what_it_should(site):
    assert classes(site) >= PLANTED | EXPECTED.get(site.place, set())


def test_all_is_finite_and_near_the_site(site):
    for part in site.scene.parts:
        assert len(part.mesh.triangles)
        assert np.isfinite(part.mesh.vertices).all()
        assert np.abs(part.mesh.vertices[:, :2] - 20).max() < 45


def test_the_path_crosses_the_site_on_free_ground(site):
    path = site.path
    assert path.shape[1] == 2
    assert path.dtype == np.float64
    assert ((path > 0) & (path < 40)).all()
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() > 20
    for part in site.scene.parts:
        if not part.instance:
            continue
        # No wall, stem or body where a sensor passes at the height of 0.5 to 1.8 m; leaves may.
        low = part.mesh.vertices[::3].astype(np.float64)
        above = low[:, 2] - site.terrain.height(low[:, :2])
        low = low[(above > 0.5) & (above < 1.8)]
        gaps = np.abs(nearest(path, low[:, :2])[0])
        if part.class_code in (CLASS_CODES["bush"], CLASS_CODES["tree"]):
            assert np.sum(gaps < 0.3) <= max(0.05 * len(gaps), 30)
        else:
            assert gaps.min(initial=np.inf) > 0.2


def test_stations_stand_free_on_the_ground(site):
    assert site.stations.shape == (3, 3)
    np.testing.assert_allclose(site.terrain.height(site.stations[:, :2]), site.stations[:, 2])
    apart = np.linalg.norm(site.stations[:, None, :2] - site.stations[:, :2], axis=2)
    assert apart[np.triu_indices(3, 1)].min() > 4
    for part in site.scene.parts:
        if part.class_code == CLASS_CODES["building"]:
            low, high = part.mesh.vertices.min(axis=0), part.mesh.vertices.max(axis=0)
            inside = (site.stations[:, :2] > low[:2]) & (site.stations[:, :2] < high[:2])
            centered = np.abs(site.stations[:, :2] - (low[:2] + high[:2]) / 2) < 0.5
            assert not (inside & centered).all(axis=1).any()


def test_nothing_but_ground_where_nothing_is_wanted():
    for place in PLACE_NAMES:
        site = site_of(place, size=20, places={place: dict(PlaceConfig.bare())})
        assert classes(site) == {"ground"}, place
        assert site.scene.num_instances == 0


def test_a_site_follows_from_its_seed():
    first, again, other = site_of("trail", 1), site_of("trail", 1), site_of("trail", 2)
    assert len(first.scene.parts) == len(again.scene.parts)
    for a, b in zip(first.scene.parts, again.scene.parts, strict=True):
        np.testing.assert_array_equal(a.mesh.vertices, b.mesh.vertices)
        assert (a.class_code, a.instance, a.material) == (b.class_code, b.instance, b.material)
    np.testing.assert_array_equal(first.path, again.path)
    assert len(first.path) != len(other.path) or not np.allclose(first.path, other.path)


def test_more_stations_leave_the_site_and_the_first_ones_as_they_were():
    few = site_of("heath", sensor=SensorConfig(stations=2))
    many = site_of("heath", sensor=SensorConfig(stations=6))
    np.testing.assert_array_equal(many.stations[:2], few.stations)
    assert len(many.scene.parts) == len(few.scene.parts)


def test_mixed_draws_places_by_weight():
    weights = {name: {"weight": 0} for name in PLACE_NAMES}
    places = {**weights, "heath": {"weight": 1}, "yard": {"weight": 3}}
    config = SimulateConfig.model_validate({"place": "mixed", "places": places})
    rng = np.random.default_rng(0)
    drawn = Counter(config.places.choose(rng) for _ in range(400))
    assert set(drawn) == {"heath", "yard"}
    assert 60 < drawn["heath"] < 140


def test_densities_reach_the_site():
    def bushes(shrubs):
        bare = PlaceConfig.bare(shrubs=shrubs)
        site = site_of("heath", size=20, places={"heath": dict(bare)})
        codes = {p.instance for p in site.scene.parts if p.class_code == CLASS_CODES["bush"]}
        return len(codes)

    assert 10 <= bushes((40, 40)) <= 16
    assert 60 <= bushes((200, 200)) <= 80
