"""Real scans as teachers: codes of ours, and nothing that doesn't say what it is."""

from pathlib import Path

import laspy
import numpy as np


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
