"""Seeds that bushseg writes itself, models and prepared data sets, and E57, which libE57 writes."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from fuzz_seeds import SEEDS, Seed

from bushseg.config import NetworkConfig, PrepareConfig, TrainConfig

PREPARED = "prepared"
_SETTINGS = PrepareConfig(
    voxel_size=0.2, num_neighbors=8, num_levels=2, tile_points=1000, crop_points=256, num_crops=2
)


def e57_seeds(folder: Path) -> Iterator[Seed]:
    """E57 of one and of two scans, with poses, colors and states."""
    import pye57

    rng = np.random.default_rng(5)
    for num_scans in (1, 2):
        path = folder / f"{num_scans}.e57"
        with pye57.E57(str(path), mode="w") as file:
            for index in range(num_scans):
                columns = dict(zip(_cartesian(), rng.normal(size=(3, 30)), strict=True))
                columns["intensity"] = rng.random(30)
                for name in ("colorRed", "colorGreen", "colorBlue"):
                    columns[name] = rng.integers(0, 255, 30).astype(np.uint8)
                if index == 0:
                    columns["cartesianInvalidState"] = np.zeros(30, np.int8)
                file.write_scan_raw(
                    columns, rotation=np.array([1.0, 0, 0, 0]), translation=np.arange(3.0)
                )
        yield Seed("a.e57", path.read_bytes(), container="e57")


def model_seeds(folder: Path) -> Iterator[Seed]:
    """A finished model, and one to go on training from."""
    import torch

    from bushseg.checkpoint import ModelCard, build_network, save_model
    from bushseg.labels import load_scheme
    from bushseg.training_state import TrainingState

    card = ModelCard(
        scheme=load_scheme("bush"),
        features=("rgb", "height"),
        optional_features=("rgb",),
        prepare=_SETTINGS,
        network=NetworkConfig(widths=(8, 8), head_widths=(4, 4)),
        neighbor_distance=(0.1, 0.3),
    )
    torch.manual_seed(0)
    path = folder / "model.safetensors"
    state = TrainingState(settings=TrainConfig()).model_dump(mode="json")
    for plain in ({}, state):
        save_model(path, card, build_network(card), state=plain)
        yield Seed(path.name, path.read_bytes(), container="safetensors")


def dataset_seeds(folder: Path) -> Iterator[Seed]:
    """The files of a prepared data set, which stays in `folder` for them to be put into."""
    from bushseg.preparation import prepare

    rng = np.random.default_rng(6)
    rows = np.column_stack([rng.uniform(0, 6, (900, 2)), rng.random(900), rng.integers(0, 9, 900)])
    scan = folder / "scan.txt"
    np.savetxt(scan, rows, fmt="%.3f", header="x y z label")
    prepare([scan], folder / PREPARED, _SETTINGS)
    for pattern in ("dataset.json", "crops-*/manifest.json", "crops-*/crop_00000.safetensors"):
        (path,) = (folder / PREPARED).glob(pattern)
        yield _member(folder, path)
    yield _member(folder, min((folder / PREPARED).rglob("tile_*.safetensors")))


def _member(folder: Path, path: Path) -> Seed:
    raw, name = path.read_bytes(), str(path.relative_to(folder / PREPARED))
    if path.suffix == ".json":
        return Seed(name, raw, text_end=len(raw))
    return Seed(name, raw, container="safetensors")


def _cartesian() -> tuple[str, str, str]:
    return "cartesianX", "cartesianY", "cartesianZ"


ALL_SEEDS: dict[str, Callable[[Path], Iterator[Seed]]] = {
    **SEEDS,
    "E57": e57_seeds,
    "model": model_seeds,
    "data set": dataset_seeds,
}
