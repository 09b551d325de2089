"""Crops on disk: drawn alike wherever zeta is held, and not made twice."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bushseg import crop_files
from bushseg.cache import read_json
from bushseg.config import PrepareConfig
from bushseg.crop_files import finished_crops, write_crops
from bushseg.prepared import DATASET, MANIFEST, SCRATCH
from bushseg.progress import SILENT
from bushseg.stages import Stages

NUM_CROPS = 16


@pytest.fixture
def crops(tmp_path: Path) -> Path:
    return tmp_path / "crops-0"


@pytest.fixture
def write(prepared: Path, crops: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Writes the crops of the prepared data set; says how many were made for it."""
    dataset = read_json(prepared / DATASET)
    config = PrepareConfig(**dataset["config"])
    assert config.num_crops == NUM_CROPS
    counts = np.array(dataset["class_counts"])
    honest = crop_files.save_tensors

    def run(max_voxels: int = 10**9, stop_at: int | None = None) -> int:
        made: list[Path] = []

        def save(path: Path, tensors: dict[str, np.ndarray]) -> None:
            if len(made) == stop_at:
                raise KeyboardInterrupt
            made.append(path)
            honest(path, tensors)

        monkeypatch.setattr(crop_files, "save_tensors", save)
        given = (prepared, crops, dataset["scans"], counts, config, max_voxels)
        try:
            write_crops(*given, SILENT, Stages())
        except KeyboardInterrupt:
            assert stop_at is not None
        return len(made)

    return run


@pytest.fixture
def undisturbed(prepared: Path, contents: Callable) -> dict[str, bytes]:
    return contents(prepared / read_json(prepared / DATASET)["crops"])


@pytest.mark.parametrize("max_voxels", [1, 10**9], ids=["on disk", "in memory"])
def test_the_same_crops_wherever_zeta_is(
    max_voxels: int,
    write: Callable[..., int],
    crops: Path,
    undisturbed: dict[str, bytes],
    contents: Callable,
) -> None:
    assert write(max_voxels) == NUM_CROPS
    assert contents(crops) == undisturbed


@pytest.mark.parametrize("max_voxels", [1, 10**9], ids=["on disk", "in memory"])
def test_crops_that_are_written_are_not_made_again(
    max_voxels: int,
    write: Callable[..., int],
    crops: Path,
    undisturbed: dict[str, bytes],
    contents: Callable,
) -> None:
    done = write(max_voxels, stop_at=5)
    assert finished_crops(crops) is None
    assert (crops / SCRATCH).exists() == (max_voxels == 1)
    (crops / ".crop_00007-abcd1234.partial.safetensors").write_text("half")
    assert done + write() == NUM_CROPS
    assert contents(crops) == undisturbed


@pytest.mark.parametrize("content", [None, b"", b"{}", "other"])
def test_a_damaged_crop_is_made_again(
    content: bytes | str | None,
    write: Callable[..., int],
    crops: Path,
    undisturbed: dict[str, bytes],
    contents: Callable,
) -> None:
    write()
    (crops / MANIFEST).unlink()
    path = crops / "crop_00003.safetensors"
    if content == "other":
        shutil.copy(crops / "crop_00004.safetensors", path)
    elif isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.unlink()
    assert write() == 1
    assert contents(crops) == undisturbed


def test_what_was_not_tidied_up_is_removed(write: Callable[..., int], crops: Path) -> None:
    write()
    (crops / SCRATCH).mkdir()
    (crops / SCRATCH / "zeta").write_text("much")
    assert finished_crops(crops) == read_json(crops / MANIFEST)
    assert not (crops / SCRATCH).exists()
