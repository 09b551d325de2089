"""A site of two tiny scans, and prepare on it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from bushseg.config import PrepareConfig
from bushseg.preparation import PrepareResult, prepare

CONFIG = PrepareConfig(
    voxel_size=0.1,
    num_neighbors=8,
    num_levels=2,
    tile_points=1_000,
    halo=16,
    crop_points=256,
    num_crops=5,
)


def _save_ply(path: Path, codes: tuple[int, ...] | None, offset: float = 0.0) -> Path:
    """A lawn of 6 x 6 m with a blob on it; codes: what the lawn and the blob are."""
    rng = np.random.default_rng(len(path.stem))
    lawn = rng.random((1_500, 3)) * [6, 6, 0]
    blob = rng.normal(size=(500, 3)) * 0.4 + [3, 3, 1]
    xyz = np.concatenate([lawn, blob]) + offset
    columns = dict(zip("xyz", xyz.T, strict=True))
    columns |= {name: rng.integers(0, 256, 2_000, "u1") for name in ("red", "green", "blue")}
    if codes:
        columns["label"] = np.repeat(codes, [1_500, 500]).astype(np.int32)
    rows = np.rec.fromarrays(list(columns.values()), names=list(columns))
    PlyData([PlyElement.describe(rows, "vertex")]).write(str(path))
    return path


@pytest.fixture
def config() -> PrepareConfig:
    return CONFIG


@pytest.fixture
def save_ply() -> Callable[..., Path]:
    return _save_ply


@pytest.fixture
def site(tmp_path: Path, new_scene: Callable, write_las: Callable) -> Path:
    """Two labelled scans: a PLY with colors, a LAS with colors and intensity."""
    folder = tmp_path / "site"
    folder.mkdir()
    _save_ply(folder / "lawn.ply", (2, 4))
    write_las(folder / "yard.las", new_scene(0, 1_500))
    return folder


@pytest.fixture
def prepare_in() -> Callable[..., PrepareResult]:
    """Prepare some scans in a folder, some settings changed."""

    def call(folder: Path, *sources: Path, **changes: object) -> PrepareResult:
        return prepare(sources, folder / "prepared", CONFIG.model_copy(update=changes))

    return call
