import laspy
import numpy as np
import pytest

from bushseg.simulation import SimulateConfig, simulate
from bushseg.simulation.scene import CLASS_CODES
from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.scanner import scan
from bushseg.simulation.sensors.tripod import tripod_rays
from bushseg.simulation.site import make_site

COARSE = SensorConfig(angular_step=1.0, stations=2)
SMALL = SimulateConfig.model_validate(
    {
        "size": 24,
        "sensor": COARSE,
        "plants": {"detail": 0.2},
        "places": {
            "garden": {
                "shrubs": (20, 20),
                "trees": (6, 6),
                "buildings": (3, 3),
                "people": (4, 4),
                "vehicles": (3, 3),
                "dead_wood": (0, 0),
            }
        },
    }
)


@pytest.fixture(scope="module")
def sites(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("sites"), SMALL.model_copy(update={"num_sites": 2}))


@pytest.fixture(scope="module")
def site(sites):
    return laspy.read(sites[0])


def test_names_and_order(sites):
    assert [path.name for path in sites] == ["site_000.laz", "site_001.laz"]
    assert sorted(path.name for path in sites[0].parent.iterdir()) == [p.name for p in sites]


def test_same_seed_same_file(sites, tmp_path):
    (again,) = simulate(tmp_path, SMALL)
    assert again.read_bytes() == sites[0].read_bytes()


def test_sites_and_seeds_differ(sites, tmp_path):
    (other,) = simulate(tmp_path, SMALL.model_copy(update={"seed": 1}))
    contents = {path.read_bytes() for path in (*sites, other)}
    assert len(contents) == 3


def test_all_classes_are_there(site):
    assert set(np.unique(site.classification)) == set(CLASS_CODES.values())


def test_header_and_dimensions(site):
    assert (str(site.header.version), site.header.point_format.id) == ("1.4", 7)
    np.testing.assert_array_equal(site.header.scales, 0.001)
    np.testing.assert_array_equal(site.header.offsets, (500_000, 5_400_000, 250))
    assert site["instance"].dtype == np.uint32
    assert site.header.global_encoding.wkt
    assert set(np.unique(site.point_source_id)) == {1, 2}
    assert (np.diff(site.gps_time) >= 0).all()
    assert site.intensity.max() > 10_000
    assert site.green.max() > 10_000


def test_coordinates_survive_projection(site):
    assert (np.abs(site.x - 500_012) < 24).all()
    assert (np.abs(site.y - 5_400_012) < 24).all()
    # Neighboring rays aren't half a metre apart, as float32 northings would have it.
    assert len(np.unique(site.y)) > len(site.y) / 4


def test_an_instance_has_one_class(site):
    pairs = np.unique(np.stack([site["instance"], site.classification]), axis=1)
    things = pairs[0, pairs[0] > 0]
    assert len(things) == len(np.unique(things))
    assert set(pairs[1, pairs[0] == 0]) == {CLASS_CODES["ground"], CLASS_CODES["low vegetation"]}
    assert 6 <= np.sum(pairs[1] == CLASS_CODES["bush"]) <= 40
    assert 1 <= np.sum(pairs[1] == CLASS_CODES["tree"]) <= 12


def test_sites_lie_side_by_side(sites):
    with laspy.open(sites[1]) as reader:
        assert reader.header.offsets[0] == 500_100


def test_nothing_lies_below_the_ground():
    sensor = COARSE.model_copy(
        update={"range_noise": 0.0, "sub_rays": 1, "registration_noise": 0.0, "angular_noise": 0.0}
    )
    config = SMALL.model_copy(update={"sensor": sensor})
    made = make_site(np.random.default_rng(5), config)
    rays = tripod_rays(np.random.default_rng(6), made, sensor)
    batches = list(scan(np.random.default_rng(7), made.scene, rays, sensor))
    xyz = np.concatenate([returns.xyz for returns in batches])
    codes = np.concatenate([returns.class_code for returns in batches])
    # Beyond the edge there is no ground: crowns overhang it.
    within = ((xyz[:, :2] > 0) & (xyz[:, :2] < config.size)).all(axis=1)
    above = xyz[within, 2] - made.terrain.height(xyz[within, :2])
    assert above.min() > -1e-3
    assert np.abs(above[codes[within] == CLASS_CODES["ground"]]).max() < 1e-3
    assert above[codes[within] == CLASS_CODES["low vegetation"]].max() < 2.0


def test_airborne_sees_the_whole_site(tmp_path):
    sensor = SensorConfig(kind="airborne", pulse_spacing=0.4)
    config = SMALL.model_copy(update={"sensor": sensor})
    las = laspy.read(simulate(tmp_path, config)[0])
    assert np.ptp(las.x) > 23
    assert np.ptp(las.y) > 23
    assert {2, 4, 5, 6} <= set(np.unique(las.classification))


def test_a_sensor_changes_nothing_on_the_site(sites, tmp_path):
    other = SMALL.model_copy(update={"sensor": SensorConfig(kind="spinning", stations=2)})
    (path,) = simulate(tmp_path, other)
    assert path.name == "site_000.bin"
    labels = np.fromfile(path.with_suffix(".label"), "<u4")
    las = laspy.read(sites[0])
    codes = dict(zip(las["instance"], las.classification, strict=True))
    seen = {(label >> 16, label & 0xFFFF) for label in np.unique(labels[labels > 0xFFFF])}
    assert len(seen & set(codes.items())) > 5
    assert all(codes.get(thing, code) == code for thing, code in seen)


def test_progress_is_told(tmp_path):
    class Watcher:
        def __init__(self):
            self.stages, self.steps, self.notes = [], 0, []

        def start(self, stage, total, unit):
            self.stages.append((total, unit))

        def advance(self, amount):
            self.steps += amount

        def note(self, message):
            self.notes.append(message)

    watcher = Watcher()
    simulate(
        tmp_path,
        SMALL.model_copy(update={"sensor": SensorConfig(angular_step=5.0)}),
        progress=watcher,
    )
    assert watcher.stages == [(1, "sites")]
    assert watcher.steps == 1
    assert "site_000.laz" in watcher.notes[0]
