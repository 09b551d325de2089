"""Real scans of seven kinds, labelled, and compared with their labelled copies by other libraries.

The comparison is the benchmarks' own (`benchmarks/fidelity.py`); the first tests prove, on files
made here, that it notices what it is there to notice.
"""

import importlib
import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
import torch

from bushseg.checkpoint import Model, ModelCard, build_network, load_model, save_model
from bushseg.config import NetworkConfig, PredictConfig, PrepareConfig
from bushseg.labels import SCHEMES
from bushseg.prediction import predict_file

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
BUSH = SCHEMES["bush"]

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:laspy")
real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no real scans at {DATA}")

Differences = Callable[[Path, Path], list[str]]


@pytest.fixture(scope="module")
def differences() -> Differences:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        module = importlib.import_module("fidelity")
    return lambda source, output: module.differences(source, output, BUSH)


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
def test_nothing_is_lost(
    name: str, output: str, random_model: Model, differences: Differences, tmp_path: Path
) -> None:
    source, target = DATA / name, tmp_path / output
    result = predict_file(source, target, random_model)
    assert sum(result.class_counts.values()) + result.num_unlabelled == result.num_points
    assert differences(source, target) == []


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


@pytest.fixture
def pair(random_model: Model, tmp_path: Path) -> tuple[Path, Path]:
    """A made-up LAS file with a VLR and an extra dimension, and its labelled copy."""
    rng = np.random.default_rng(1)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = [0.01] * 3
    header.vlrs.append(laspy.VLR("someone", 3, "", b"payload"))
    header.add_extra_dim(laspy.ExtraBytesParams("height", "f4"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = rng.uniform(0, 20, (3, 300))
    las.intensity = rng.integers(0, 65535, 300)
    las["height"][:] = rng.random(300)
    source, target = tmp_path / "source.las", tmp_path / "target.las"
    las.write(str(source))
    predict_file(source, target, random_model)
    return source, target


def test_a_faithful_copy_shows_no_difference(
    pair: tuple[Path, Path], differences: Differences
) -> None:
    assert differences(*pair) == []


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ("GUID", "header: GUID"),
        ("scale", "header: scales and offsets"),
        ("count", "header: counts"),
        ("bounds", "header: bounds"),
        ("vlr", "VLR someone 3"),
        ("intensity", "field intensity of 1 points"),
        ("height", "field height of 1 points"),
        ("classification", "class codes that contradict class_index"),
        ("class_index", "class_index beyond the scheme's classes"),
        ("confidence", "confidence outside 0 to 1"),
    ],
)
def test_a_single_changed_byte_shows(
    place: str, expected: str, pair: tuple[Path, Path], differences: Differences
) -> None:
    source, target = pair
    raw = bytearray(target.read_bytes())
    (points,) = struct.unpack_from("<I", raw, 96)
    at = {
        "GUID": 8,
        "scale": 131,
        "count": 255,  # points of the first return
        "bounds": 185,
        "vlr": raw.index(b"payload"),
        "intensity": points + 12,
        "classification": points + 16,
        "height": points + 30,
        "class_index": points + 34,
        "confidence": points + 38,  # a float's exponent
    }[place]
    raw[at] ^= 0x7F
    target.write_bytes(raw)
    assert expected in differences(source, target)
