"""Real scans of seven kinds, labelled, and compared with their labelled copies by `verify`.

What it notices is tested in `verification/`.
"""

from pathlib import Path

import laspy
import numpy as np
import pytest
import torch

from bushseg.checkpoint import Model, ModelCard, build_network, load_model, save_model
from bushseg.config import NetworkConfig, PredictConfig, PrepareConfig
from bushseg.labels import SCHEMES
from bushseg.prediction import predict_file
from bushseg.verification import verify

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
BUSH = SCHEMES["bush"]

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no real scans at {DATA}")


@pytest.fixture(scope="module")
def random_model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """Weights that mean nothing, over voxels coarse enough to be quick."""
    card = ModelCard(
        scheme=BUSH,
        features=("height",),
        prepare=PrepareConfig(voxel_size=0.8, num_neighbors=4, num_levels=2, halo=16),
        network=NetworkConfig(widths=(4, 8), stem_width=4, head_widths=(4, 4)),
        neighbor_distance=(0.5, 2.0),
    )
    path = tmp_path_factory.mktemp("model") / "random.safetensors"
    torch.manual_seed(0)
    save_model(path, card, build_network(card))
    return load_model(path)


@real
@pytest.mark.parametrize(
    ("name", "output"),
    [
        ("forest/LPine1_demo.laz", "out.laz"),
        ("forest/bcts_1.laz", "out.las"),
        ("forest/autzen_test.copc.laz", "out.laz"),
        ("ign/extra_byte_bloc_350m.laz", "out.laz"),
        ("forest/pc_tree.ply", "out.ply"),
        ("forest/pc_tree.ply", "out.las"),
        ("forest/moving_ground_t0.pcd", "out.ply"),
        ("forest/moving_ground_t0.pcd", "out.laz"),
        ("frames/seq00_000000.bin", "out.label"),
        ("frames/seq00_000000.bin", "out.ply"),
        ("edge/laspy/tests__1_4_w_evlr.laz", "out.las"),
        ("edge/rlas/inst__extdata__extra_byte.laz", "out.laz"),
    ],
)
def test_nothing_is_lost(name: str, output: str, random_model: Model, tmp_path: Path) -> None:
    source, target = DATA / name, tmp_path / output
    result = predict_file(source, target, random_model)
    assert sum(result.class_counts.values()) + result.num_unlabelled == result.num_points
    assert verify(source, target, BUSH).differences == ()


@real
def test_classification_may_be_left_alone(random_model: Model, tmp_path: Path) -> None:
    source, target = DATA / "ign" / "KM_1.laz", tmp_path / "out.laz"
    predict_file(source, target, random_model, PredictConfig(keep_classification=True))
    before, after = laspy.read(source), laspy.read(target)
    np.testing.assert_array_equal(before.classification, after.classification)
    assert len(np.unique(after.classification)) == 6


@real
def test_a_legacy_format_keeps_all_classes_in_class_index(
    random_model: Model, tmp_path: Path
) -> None:
    # The network's last bias decides everything: all points become "vehicle_person", LAS code 65.
    with torch.no_grad():
        bias = list(random_model.network.parameters())[-1]
        before = bias.clone()
        bias[-1] += 1e6
    try:
        source, target = DATA / "forest" / "MixedConifer.laz", tmp_path / "out.laz"
        result = predict_file(source, target, random_model)
    finally:
        with torch.no_grad():
            bias.copy_(before)
    las = laspy.read(target)
    assert (np.asarray(las.class_index) == BUSH.names.index("vehicle_person")).all()
    assert (np.asarray(las.classification) == 1).all()
    (warning,) = [line for line in result.warnings if "LAS point formats" in line]
    assert "vehicle_person (65)" in warning
