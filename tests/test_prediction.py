from pathlib import Path

import laspy
import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from bushseg.config import PredictConfig
from bushseg.errors import DataError
from bushseg.io import open_scan
from bushseg.labels import load_scheme
from bushseg.points import PointCloud
from bushseg.prediction import predict, predict_file
from bushseg.scan import read_voxels

UNLABELLED = 255


@pytest.fixture
def south(scans) -> Path:
    return scans / "south.las"


@pytest.fixture(scope="module")
def labeled(model, scans, tmp_path_factory):
    """What predict_file says and writes for a LAS scan, read by laspy."""
    output = tmp_path_factory.mktemp("labeled") / "south.las"
    return predict_file(scans / "south.las", output, model), laspy.read(output)


def write_ply(path: Path, xyz: np.ndarray, intensity: np.ndarray) -> None:
    names = [("x", "f8"), ("y", "f8"), ("z", "f8"), ("intensity", "u2"), ("ring", "i4")]
    rows = np.empty(len(xyz), names)
    rows["x"], rows["y"], rows["z"] = xyz.T
    rows["intensity"], rows["ring"] = intensity, np.arange(len(xyz))
    PlyData([PlyElement.describe(rows, "vertex")]).write(path)


def test_every_field_of_every_point_stays(labeled, scans):
    _, after = labeled
    before = laspy.read(scans / "south.las")
    assert len(after) == len(before)
    for name in before.point_format.dimension_names:
        if name != "classification":
            np.testing.assert_array_equal(after[name], before[name], err_msg=name)
    assert after.header.scales.tolist() == before.header.scales.tolist()
    assert after.header.offsets.tolist() == before.header.offsets.tolist()
    assert list(after.point_format.extra_dimension_names) == [
        "class_index",
        "confidence",
        "bush_probability",
    ]


def test_the_model_is_right_about_most_points(labeled, scans):
    _, after = labeled
    truth = np.asarray(laspy.read(scans / "south.las").classification)
    assert (np.asarray(after.classification) == truth).mean() > 0.6


def test_columns_agree_with_each_other(labeled):
    result, after = labeled
    scheme = load_scheme("bush")
    index = np.asarray(after["class_index"])
    assert index.dtype == np.uint8
    np.testing.assert_array_equal(after.classification, scheme.to_asprs(index.astype(int)))
    confidence, bush = np.asarray(after["confidence"]), np.asarray(after["bush_probability"])
    assert confidence.dtype == bush.dtype == np.float32
    assert confidence.min() > 1 / 7 - 1e-6
    assert confidence.max() <= 1
    is_bush = index == scheme.bush_index
    np.testing.assert_array_equal(bush[is_bush], confidence[is_bush])
    assert (bush[~is_bush] <= confidence[~is_bush]).all()
    counts = np.bincount(index, minlength=7).tolist()
    assert list(result.class_counts.values()) == counts


def test_what_the_result_says(labeled, run, south):
    result, after = labeled
    assert result.model == str(run / "best.safetensors")
    assert result.input == south
    assert (result.num_points, result.num_unlabelled) == (len(after), 0)
    assert 0 < result.num_voxels < result.num_points
    assert result.passes == 1  # one tile
    assert sum(result.stages.values()) == pytest.approx(result.seconds, rel=0.2)
    assert result.peak_memory is None or result.peak_memory > 1e6
    assert result.warnings == ()


def test_every_point_gets_the_label_of_its_voxel(labeled, model, south):
    """Voxels told apart by their cell in a dictionary, not by Morton codes."""
    _, after = labeled
    with open_scan(south) as reader:
        xyz = reader.read().xyz
        grid = read_voxels(reader, 0.15).voxels.grid
    answers: dict[tuple[int, ...], set[tuple[float, ...]]] = {}
    columns = zip(after["class_index"], after["confidence"], strict=True)
    for cell, answer in zip(np.floor((xyz - grid.origin) / 0.15).tolist(), columns, strict=True):
        answers.setdefault(tuple(cell), set()).add(answer)
    assert len(answers) < len(xyz)
    assert all(len(given) == 1 for given in answers.values())


def test_predict_in_memory_agrees_with_the_file(labeled, model, south):
    _, after = labeled
    las = laspy.read(south)
    attributes = {name: np.asarray(las[name]) for name in ("intensity", "red", "green", "blue")}
    xyz = np.asarray(las.xyz)
    labels, probabilities = predict(xyz, model, attributes=attributes)
    assert labels.dtype == np.int16
    assert probabilities.shape == (len(las), 7)
    np.testing.assert_array_equal(labels, after["class_index"])
    np.testing.assert_allclose(probabilities.max(axis=1), after["confidence"], rtol=1e-6)
    again, _ = predict(PointCloud(xyz, attributes), model)
    np.testing.assert_array_equal(again, labels)


def test_predict_in_memory_takes_plain_lists(height_model):
    labels, probabilities = predict(
        [[0, 0, 0], [1, 0, 0], [float("nan"), 0, 0]], height_model, attributes={"ring": [1, 2, 3]}
    )
    assert labels[2] == -1
    assert (labels[:2] >= 0).all()
    np.testing.assert_allclose(probabilities.sum(axis=1), [1, 1, 0], rtol=1e-5)


def test_predict_in_memory_knows_no_returns_of_a_frame(height_model):
    rng = np.random.default_rng(3)
    xyz = rng.uniform(-4, 4, (500, 3)) * [1, 1, 0.05] - [0, 0, 1.5]
    xyz[::5] = 0
    labels, probabilities = predict(xyz, height_model, sensor=(0, 0, 0))
    assert (labels[::5] == -1).all()
    assert not probabilities[::5].any()
    assert (np.delete(labels, np.s_[::5]) >= 0).all()
    # Without a sensor there, (0, 0, 0) is a point like any other.
    assert (predict(xyz, height_model)[0] >= 0).all()


@pytest.mark.parametrize("points", [[], [[1, 2]], [1, 2, 3], [[np.nan, 0, 0]]])
def test_predict_in_memory_needs_points(height_model, points):
    with pytest.raises(DataError):
        predict(points, height_model)


def test_tiles_leave_no_trace(labeled, model, south, tmp_path):
    _, whole = labeled
    config = PredictConfig(tile_points=1000, halo=32)
    result = predict_file(south, tmp_path / "tiled.las", model, config)
    tiled = laspy.read(tmp_path / "tiled.las")
    assert result.passes > 1.2
    differing = np.asarray(tiled["class_index"]) != np.asarray(whole["class_index"])
    assert differing.mean() < 0.005


def test_a_scan_far_away_gets_the_same_labels(labeled, model, south, tmp_path):
    _, here = labeled
    raw = south.read_bytes()
    moved = tmp_path / "moved.las"
    # The offsets alone: three doubles at byte 155 of the header.
    offsets = np.frombuffer(raw, "<f8", 3, 155) + np.array([500_000, 6_600_000, 0])
    moved.write_bytes(raw[:155] + offsets.tobytes() + raw[179:])
    predict_file(moved, tmp_path / "there.las", model)
    there = laspy.read(tmp_path / "there.las")
    assert there.y.min() > 6_599_999
    np.testing.assert_array_equal(there["class_index"], here["class_index"])
    np.testing.assert_allclose(there["confidence"], here["confidence"], atol=1e-3)


def test_keep_classification(model, south, tmp_path):
    config = PredictConfig(keep_classification=True)
    predict_file(south, tmp_path / "out.las", model, config)
    after, before = laspy.read(tmp_path / "out.las"), laspy.read(south)
    np.testing.assert_array_equal(after.classification, before.classification)
    assert "class_index" in after.point_format.dimension_names


def test_asprs_mapping(labeled, model, south, tmp_path):
    _, before = labeled
    config = PredictConfig(asprs={"bush": 77, "ground": 31})
    predict_file(south, tmp_path / "out.las", model, config)
    after = laspy.read(tmp_path / "out.las")
    expected = np.asarray(before.classification).copy()
    expected[before["class_index"] == 2] = 77
    expected[before["class_index"] == 0] = 31
    np.testing.assert_array_equal(after.classification, expected)


def test_legacy_point_formats_have_no_high_codes(model, new_scene, write_las, tmp_path):
    scan = write_las(tmp_path / "legacy.las", new_scene(2, 2000), point_format=2)
    config = PredictConfig(asprs={"ground": 64, "bush": 4, "building": 69})
    result = predict_file(scan, tmp_path / "out.las", model, config)
    after = laspy.read(tmp_path / "out.las")
    assert after.point_format.id == 2
    index = np.asarray(after["class_index"])
    expected = np.where(index == 2, 4, np.where(np.isin(index, [1, 3]), index + 2, 1))
    np.testing.assert_array_equal(after.classification, expected)
    (warning,) = result.warnings
    assert "ground (64)" in warning
    assert "bush" not in warning.replace("bushseg", "")


def test_ply_keeps_its_attributes(height_model, new_scene, tmp_path):
    scene = new_scene(4, 1500)
    write_ply(tmp_path / "scan.ply", scene.xyz, scene.intensity)
    result = predict_file(tmp_path / "scan.ply", tmp_path / "out.ply", height_model)
    before = PlyData.read(tmp_path / "scan.ply")["vertex"].data
    after = PlyData.read(tmp_path / "out.ply")["vertex"].data
    for name in before.dtype.names:
        np.testing.assert_array_equal(after[name], before[name])
        assert after[name].dtype == before[name].dtype
    counts = np.bincount(after["class_index"], minlength=7)
    assert counts.tolist() == list(result.class_counts.values())


def test_a_frame_becomes_labels(height_model, new_scene, tmp_path):
    scene = new_scene(5, 1500)
    rows = np.column_stack([scene.xyz, scene.intensity / 65535]).astype("<f4")
    rows[::10, :3] = 0  # pulses that did not return
    rows[1, :3] = 0.001  # one that did, from the same voxel
    rows.tofile(tmp_path / "frame.bin")
    result = predict_file(tmp_path / "frame.bin", tmp_path / "out.label", height_model)
    codes = np.fromfile(tmp_path / "out.label", "<u4")
    assert len(codes) == len(rows)
    scheme = height_model.card.scheme
    assert (codes[::10] == scheme.unlabelled[0]).all()
    assert {codes[1], *codes[1::10]} <= {info.codes[0] for info in scheme.classes}
    assert result.num_unlabelled == 150
    assert sum(result.class_counts.values()) == 1350


def test_text_becomes_labels(height_model, new_scene, tmp_path):
    scene = new_scene(6, 800)
    table = np.column_stack([scene.xyz, scene.intensity, scene.rgb // 256])
    np.savetxt(tmp_path / "scan.txt", table, fmt="%.3f %.3f %.3f %d %d %d %d")
    predict_file(tmp_path / "scan.txt", tmp_path / "out.labels", height_model)
    codes = np.loadtxt(tmp_path / "out.labels", dtype=int)
    labels, _ = predict(np.round(scene.xyz, 3), height_model)
    np.testing.assert_array_equal(codes, height_model.card.scheme.decode(labels))


def test_points_that_are_not_finite_stay_in_the_output(height_model, new_scene, tmp_path):
    scene = new_scene(7, 1000)
    xyz = scene.xyz.copy()
    xyz[[0, 10, 999]] = [[np.nan] * 3, [np.inf, 0, 0], [0, 0, np.nan]]
    write_ply(tmp_path / "scan.ply", xyz, scene.intensity)
    result = predict_file(tmp_path / "scan.ply", tmp_path / "out.ply", height_model)
    after = PlyData.read(tmp_path / "out.ply")["vertex"].data
    assert len(after) == 1000
    bad = np.flatnonzero(after["class_index"] == UNLABELLED)
    assert bad.tolist() == [0, 10, 999]
    assert (after["confidence"][bad] == 0).all()
    assert (after["bush_probability"][bad] == 0).all()
    np.testing.assert_array_equal(after["x"], xyz[:, 0])
    assert result.num_unlabelled == 3
    labels, probabilities = predict(xyz, height_model)
    assert np.flatnonzero(labels == -1).tolist() == [0, 10, 999]
    assert not probabilities[bad].any()
