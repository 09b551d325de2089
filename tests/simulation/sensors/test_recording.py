import laspy
import numpy as np
import pytest

from bushseg.errors import DataError
from bushseg.simulation.materials import Material
from bushseg.simulation.mesh import Surface, box, polyhedron
from bushseg.simulation.scene import Scene
from bushseg.simulation.sensors import SensorConfig
from bushseg.simulation.sensors.figures import PRESETS
from bushseg.simulation.sensors.recording import SENSORS, record
from bushseg.simulation.site import Site
from bushseg.simulation.terrain import Terrain

ORIGIN = np.array([500_000.0, 5_400_000.0, 250.0])
COARSE = {"angular_step": 2.0, "turn_spacing": 4.0, "pulse_spacing": 0.5}


@pytest.fixture(scope="module")
def site():
    """A lawn of 20 m with a block on it."""
    terrain = Terrain(np.zeros((51, 51)), cell=0.4)
    lawn = polyhedron([(0, 0, 0), (20, 0, 0), (20, 20, 0), (0, 20, 0)], [(0, 1, 2, 3)])
    scene = Scene()
    scene.add([Surface(lawn, Material(0.4, (90, 120, 60)))], "ground", instance=False)
    block = box((8, 13, 0), (12, 15, 3))
    scene.add([Surface(block, Material(0.6, (200, 200, 200)))], "building")
    return Site(scene, terrain, np.array([(3.0, 8.0, 0.0), (17.0, 8.0, 0.0)]))


def run(site, tmp_path, **settings):
    config = SensorConfig(**{**COARSE, **settings})
    return record(np.random.default_rng(3), site, config, tmp_path / "site_000", ORIGIN)


def test_every_kind_has_a_sensor():
    assert list(SENSORS) == list(PRESETS)


@pytest.mark.parametrize("kind", [kind for kind in SENSORS if kind != "spinning"])
def test_maps_hold_what_is_there(site, tmp_path, kind):
    (path,) = run(site, tmp_path, kind=kind)
    las = laspy.read(path)
    assert np.unique(las.classification).tolist() == [2, 6]
    np.testing.assert_array_equal(las["instance"], np.asarray(las.classification) == 6)
    assert (np.asarray(las.return_number) <= np.asarray(las.number_of_returns)).all()
    ground = np.asarray(las.z)[np.asarray(las.classification) == 2] - 250
    assert np.median(np.abs(ground)) < 0.15
    inside = (np.abs(np.asarray(las.x) - 500_010) < 10.5) & (
        np.abs(np.asarray(las.y) - 5_400_010) < 10.5
    )
    assert inside.mean() > 0.99


def test_the_same_stream_gives_the_same_file(site, tmp_path):
    (path,) = run(site, tmp_path, kind="uav")
    once = path.read_bytes()
    (path,) = run(site, tmp_path, kind="uav")
    assert path.read_bytes() == once


def test_sensors_may_vary(site, tmp_path):
    (path,) = run(site, tmp_path, kind="uav")
    once = path.read_bytes()
    (path,) = run(site, tmp_path, kind="uav", vary=True)
    assert path.read_bytes() != once


def test_frames_are_numbered_and_keep_their_zeros(site, tmp_path):
    written = run(site, tmp_path, kind="spinning", frames=2)
    assert [path.name for path in written] == ["site_000_000.bin", "site_000_001.bin"]
    for path, number in written.items():
        points = np.fromfile(path, "<f4").reshape(-1, 4)
        labels = np.fromfile(path.with_suffix(".label"), "<u4")
        assert len(points) == len(labels) == number == 64 * 180
        missing = (points[:, :3] == 0).all(axis=1)
        assert 0.3 < missing.mean() < 0.9
        np.testing.assert_array_equal(labels == 0, missing)
        assert set(np.unique(labels & 0xFFFF)) == {0, 2, 6}
        np.testing.assert_array_equal(labels >> 16, (labels & 0xFFFF) == 6)
        # The ground lies a sensor's height below.
        assert np.median(points[(labels & 0xFFFF) == 2, 2]) == pytest.approx(-1.6, abs=0.1)
        assert points[:, 3].max() <= 1


def test_one_frame_has_no_number(site, tmp_path):
    assert [path.name for path in run(site, tmp_path, kind="spinning")] == ["site_000.bin"]


@pytest.mark.parametrize("kind", ["tripod", "spinning"])
def test_no_returns_leave_no_file(site, tmp_path, kind):
    with pytest.raises(DataError, match="max_range"):
        run(site, tmp_path, kind=kind, min_range=1e-4, max_range=1e-3)
    assert list(tmp_path.iterdir()) == []
