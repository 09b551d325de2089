"""Which model is used where none, or one, is named."""

from pathlib import Path

import numpy as np
import pytest

from bushseg.config import PrepareConfig
from bushseg.errors import CheckpointError
from bushseg.io import open_scan
from bushseg.io.kept import KeptReader
from bushseg.io.memory import MemoryReader
from bushseg.model_choice import Candidate, available, candidates, choose, choose_prepared
from bushseg.points import PointCloud

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def ground(per_square_metre: float, edge: float = 40.0) -> np.ndarray:
    rng = np.random.default_rng(0)
    flat = rng.uniform(0, edge, (round(per_square_metre * edge**2), 2))
    return np.column_stack([flat, rng.normal(0, 0.02, len(flat))])


def frame() -> np.ndarray:
    """Rings around a sensor 2 m above the ground: dense along a ring, sparser with distance."""
    below, around = np.meshgrid(np.radians(np.linspace(2, 25, 64)), np.linspace(0, 6.28, 1800))
    reach = 2 / np.tan(below)
    return np.stack([reach * np.cos(around), reach * np.sin(around), 0 * reach - 2], -1).reshape(
        -1, 3
    )


def chosen(xyz: np.ndarray) -> tuple[str, str]:
    found, reason = choose(candidates(), KeptReader(MemoryReader(PointCloud(xyz))))
    return found.name, reason


def add_run(name: str, run: Path) -> None:
    folder = Path("runs") / name
    folder.mkdir(parents=True)
    (folder / "best.safetensors").write_bytes((run / "best.safetensors").read_bytes())


@pytest.mark.parametrize(
    ("xyz", "name"),
    [
        (ground(400), "close"),
        (ground(5), "airborne"),
        (ground(8), "airborne"),
        (frame(), "close"),
        (ground(0.05, 200), "airborne"),  # fits neither: the nearer one
    ],
)
def test_density_decides(bundle, xyz, name):
    found, reason = chosen(xyz)
    assert found == f'bundled "{name}"'
    assert "8 neighbors lie within" in reason


def test_the_same_points_in_any_order(bundle):
    xyz = ground(8)
    assert chosen(xyz[::-1])[0] == chosen(xyz)[0]


def test_a_run_comes_before_what_is_bundled(bundle, run):
    add_run("mine", run)
    (found,) = candidates()
    assert found.name == "runs/mine/best.safetensors"
    assert [it.name for it in candidates("default")] == ['bundled "close"', 'bundled "airborne"']


def test_names(bundle, run, model):
    add_run("mine", run)
    (airborne,) = candidates("airborne")
    assert airborne.card.prepare.voxel_size == 0.6
    assert airborne.load().path == bundle / "airborne.safetensors"
    for name in ("mine", "runs/mine", "runs/mine/best.safetensors", run):
        assert candidates(name)[0].card.prepare.voxel_size == 0.15
    (given,) = candidates(model)
    assert given.load() is model


def test_an_unknown_name_is_told_the_known_ones(bundle):
    with pytest.raises(CheckpointError, match=r"far: no such model.*bundled are close, airborne"):
        candidates("far")


@pytest.mark.parametrize("name", [None, "default"])
def test_nothing_bundled_and_no_run(tmp_path, monkeypatch, name):
    (tmp_path / "index.toml").write_text("models = []\n")
    monkeypatch.setattr("bushseg.bundled.FOLDER", tmp_path)
    with pytest.raises(CheckpointError, match=r"none is bundled.*bushseg train"):
        candidates(name)
    assert available() == []


def test_a_scan_without_points_takes_any(bundle):
    assert chosen(np.full((3, 3), np.nan))[0] == 'bundled "close"'


def test_a_prepared_data_set_takes_the_model_of_its_voxel_size(bundle):
    for voxel_size, name in ((0.15, "close"), (0.6, "airborne"), (0.5, "airborne")):
        found = choose_prepared(candidates("default"), PrepareConfig(voxel_size=voxel_size))
        assert found.name == f'bundled "{name}"'


def test_what_is_available(bundle, run):
    assert [(it.name, it.is_default) for it in available()] == [("close", True), ("airborne", True)]
    add_run("mine", run)
    assert [(it.name, it.is_default) for it in available()] == [
        ("close", False),
        ("airborne", False),
        ("runs/mine", True),
    ]


@pytest.mark.parametrize(
    ("scan", "name"),
    [
        ("forest/TLS_Clip.laz", "close"),
        ("forest/MLS_Clip.laz", "close"),
        ("forest/QuePet_BR02_02_2019-08-24_q2_ULS-on.laz", "close"),
        ("frames/seq00_000000.bin", "close"),
        ("odm/brighton_small.laz", "close"),
        ("forest/MixedConifer.laz", "airborne"),
        ("forest/points_rgb.laz", "airborne"),
        ("forest/autzen_test.copc.laz", "airborne"),
        ("ign/ign_77050_627755.laz", "airborne"),
        ("ign/origin_dsmMarker.laz", "airborne"),
    ],
)
def test_real_scans(model, scan, name):
    """With the voxel sizes that bundled models have, 16 neighbors, and densities as they see."""
    path = DATA / scan
    if not path.exists():
        pytest.skip(f"no {path}")
    among = []
    for known, voxel_size, distances in (("close", 0.1, (0.2, 1.0)), ("airborne", 0.3, (0.5, 3))):
        prepare = PrepareConfig(voxel_size=voxel_size)
        changes = {"prepare": prepare, "neighbor_distance": distances}
        among.append(Candidate(known, model.card.model_copy(update=changes), model))
    with open_scan(path) as reader:
        assert choose(among, KeptReader(reader))[0].name == name
