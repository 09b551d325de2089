"""Real scans as teachers: codes of ours, and nothing that doesn't say what it is."""

from pathlib import Path

import laspy
import numpy as np
from scipy.spatial import cKDTree


def write_object(path: Path, code: int) -> None:
    las = laspy.LasData(laspy.LasHeader(version="1.4", point_format=6))
    las.x, las.y, las.z = np.random.default_rng(0).random((3, 400)) * 3
    las.classification = np.full(400, code, np.uint8)
    path.parent.mkdir(exist_ok=True)
    las.write(path)


def test_objects_get_our_codes_and_a_ground(recipe_module, tmp_path):
    write_object(tmp_path / "vle" / "SA1_Bush_1.las", 15)
    write_object(tmp_path / "vle" / "SA1_WoodyEdge_1.las", 14)
    write_object(tmp_path / "vle" / "SA2_Bush_1.las", 15)
    write_object(tmp_path / "ign" / "tile.laz", 4)
    recipe_module("real").write_real_scans(tmp_path, tmp_path / "out")
    codes = {
        path.stem: set(np.unique(laspy.read(path).classification))
        for path in (tmp_path / "out").iterdir()
    }
    assert codes == {"vle_SA1_Bush_1": {4, 2}, "vle_SA1_WoodyEdge_1": {1, 2}, "ign_tile": {1}}


def test_plantings_hold_what_may_teach_on_one_ground(recipe_module, tmp_path):
    write_object(tmp_path / "vle" / "SA1_Bush_1.las", 15)
    write_object(tmp_path / "vle" / "SA1_Tree_1.las", 12)
    write_object(tmp_path / "vle" / "SA1_WoodyEdge_1.las", 14)
    write_object(tmp_path / "vle" / "SA2_Hedgerow_1.las", 13)
    make = recipe_module("plantings").plantings
    first, second = make(tmp_path, 2, seed=3)
    assert [scan.path.name for scan in (first, second)] == ["planting_00", "planting_01"]
    assert set(first.codes) == set(second.codes) == {15, 12, -1}
    assert not np.array_equal(first.cloud.xyz[:400], second.cloud.xyz[:400])
    again = make(tmp_path, 2, seed=3)[1]
    np.testing.assert_array_equal(again.cloud.xyz, second.cloud.xyz)
    ground = cKDTree(first.cloud.xyz[first.codes == -1, :2])
    level = first.cloud.xyz[first.codes == -1, 2]
    lifts = {15: [], 12: []}
    for start in range(0, np.count_nonzero(first.codes != -1), 400):
        part = first.cloud.xyz[start : start + 400]
        assert len(set(first.codes[start : start + 400])) == 1
        assert np.ptp(part[:, :2], axis=0).max() <= 3 * np.sqrt(2)
        lowest = part[part[:, 2].argmin()]
        below = level[ground.query(part[:, :2].mean(axis=0), k=20)[1]].mean()
        lifts[first.codes[start]].append(lowest[2] - below)
    assert np.abs(lifts[15]).max() < 0.1
    assert min(lifts[12]) > -0.1
    assert 0.3 < max(lifts[12]) <= 1.6
