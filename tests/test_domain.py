from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bushseg.domain import domain_warnings
from bushseg.io import open_scan
from bushseg.prediction import predict_file
from bushseg.scan import VoxelScan, read_voxels


@pytest.fixture(scope="module")
def scan(scans, model) -> VoxelScan:
    with open_scan(scans / "south.las") as reader:
        return read_voxels(reader, model.card.prepare.voxel_size)


@pytest.fixture
def say(model):
    """What is said of a scan of the model's own density."""

    def warn(scan: VoxelScan, distance: float | None = None, **about) -> list[str]:
        low, high = model.card.neighbor_distance
        return domain_warnings(model.card, scan, distance or (low + high) / 2, **about)

    return warn


def without(scan: VoxelScan, *names: str) -> VoxelScan:
    kept = {name: columns for name, columns in scan.features.items() if name not in names}
    return replace(scan, features=kept)


def with_heights(scan: VoxelScan, heights: np.ndarray) -> VoxelScan:
    column = (heights / 5).astype(np.float32)[:, None]
    return replace(scan, features=scan.features | {"height": column})


def test_a_scan_like_those_it_learnt_from(say, scan, model):
    assert say(scan, confidence=model.card.confidence, crs='UNIT["metre",1]') == []


def test_a_feature_that_training_dropped_is_not_missed(say, scan):
    assert say(without(scan, "rgb", "intensity")) == []


@pytest.mark.parametrize(
    ("factor", "word"), [(0.5, "denser"), (0.9, None), (1.1, None), (2.0, "sparser")]
)
def test_density(model, scan, factor, word):
    low, high = model.card.neighbor_distance
    warnings = domain_warnings(model.card, scan, factor * (low if factor < 1 else high))
    assert len(warnings) == (word is not None)
    assert all(word in warning for warning in warnings)


@pytest.mark.parametrize(
    "crs", ['LOCAL_CS["x",UNIT["US survey foot",0.3048]]', "Units=9003", 'UNIT["Foot_US",0.3048]']
)
def test_feet(say, scan, crs):
    (warning,) = say(scan, crs=crs)
    assert "feet" in warning


def test_degrees(say, scan):
    voxels = replace(scan.voxels, xyz=scan.voxels.xyz * [1e-5, 1e-5, 1])
    (warning,) = say(replace(scan, voxels=voxels))
    assert "degrees" in warning


def test_heights_in_feet(say, scan):
    heights = scan.features["height"][:, 0] * 5
    (warning,) = say(with_heights(scan, heights * 3.28))
    assert "above its ground" in warning
    assert "metres" in warning


def test_far_below_the_ground(say, scan):
    heights = scan.features["height"][:, 0] * 5
    heights[::20] = -8
    (warning,) = say(with_heights(scan, heights))
    assert "below what looks like its ground" in warning


def test_without_ground(say, scan):
    heights = scan.features["height"][:, 0] * 5
    above = heights > 0.5
    heights[~above] = np.random.default_rng(0).choice(heights[above], np.count_nonzero(~above))
    (warning,) = say(with_heights(scan, heights))
    assert "near the ground" in warning


def test_an_unsure_model(say, scan, model):
    assert say(scan, confidence=model.card.confidence - 0.1) == []
    (warning,) = say(scan, confidence=model.card.confidence - 0.2)
    assert "mean confidence" in warning


def test_a_card_that_says_nothing_of_heights(model, scan):
    card = model.card.model_copy(update={"heights": None, "low_share": None, "confidence": None})
    assert domain_warnings(card, scan, card.neighbor_distance[0], confidence=0.1) == []


def test_a_real_scan_in_feet(height_model, tmp_path):
    scan = Path(__file__).resolve().parents[2] / "shared/data/forest/autzen_test.copc.laz"
    if not scan.exists():
        pytest.skip(f"no {scan}")
    result = predict_file(scan, tmp_path / "out.laz", height_model)
    assert "counts in feet" in result.warnings[0]
    assert any("sparser" in warning for warning in result.warnings)
