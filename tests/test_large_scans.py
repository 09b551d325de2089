"""Scans whose voxels go to disk, and runs that are broken off and gone on with."""

from collections.abc import Callable
from pathlib import Path

import pytest

from bushseg import tiled_scan, voxel_labels
from bushseg.config import PredictConfig
from bushseg.errors import CacheError
from bushseg.prediction import predict_file
from bushseg.stored_scan import MANIFEST, open_stored

TILES = PredictConfig(tile_points=1000)
MODES = pytest.mark.parametrize("max_voxels", [10**9, 300], ids=["in memory", "on disk"])


@pytest.fixture(scope="module")
def model_file(run: Path) -> Path:
    return run / "best.safetensors"


@pytest.fixture(scope="module")
def undisturbed(scans, model_file, tmp_path_factory) -> bytes:
    output = tmp_path_factory.mktemp("whole") / "out.las"
    predict_file(scans / "south.las", output, model_file, TILES)
    return output.read_bytes()


@pytest.fixture
def label(scans, model_file, tmp_path, monkeypatch) -> Callable[..., list[int]]:
    """Labels a scan and lists the sizes of the tiles that passed the network."""
    honest = voxel_labels.label_tile

    def run(max_voxels: int, stop_at: int | None = None, **settings: int) -> list[int]:
        done: list[int] = []

        def watched(*args):
            if len(done) == stop_at:
                raise KeyboardInterrupt
            done.append(args[3].num_points)
            return honest(*args)

        monkeypatch.setattr(voxel_labels, "label_tile", watched)
        monkeypatch.setattr(tiled_scan, "MAX_VOXELS", max_voxels)
        config = TILES.model_copy(update=settings)
        try:
            predict_file(scans / "south.las", tmp_path / "out.las", model_file, config)
        except KeyboardInterrupt:
            assert stop_at is not None
        return done

    return run


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


@MODES
def test_the_same_bytes_wherever_voxels_are(max_voxels, label, undisturbed, tmp_path):
    assert len(label(max_voxels)) > 3
    assert (tmp_path / "out.las").read_bytes() == undisturbed
    assert left(tmp_path) == ["out.las"]


@MODES
def test_a_run_that_was_broken_off_is_gone_on_with(max_voxels, label, undisturbed, tmp_path):
    first = label(max_voxels, stop_at=2)
    assert not (tmp_path / "out.las").exists()
    assert [name for name in left(tmp_path) if name.startswith("tile_")] == [
        "tile_000000.safetensors",
        "tile_000001.safetensors",
    ]
    rest = label(max_voxels)
    assert (tmp_path / "out.las").read_bytes() == undisturbed
    assert left(tmp_path) == ["out.las"]
    (tmp_path / "out.las").unlink()
    assert first + rest == label(max_voxels)


def test_voxels_on_disk_are_not_read_again(label, undisturbed, tmp_path, monkeypatch):
    label(300, stop_at=1)
    monkeypatch.setattr(tiled_scan, "read_voxels", None)
    label(300)
    assert (tmp_path / "out.las").read_bytes() == undisturbed


@MODES
def test_other_settings_do_not_take_it_up(max_voxels, label, tmp_path):
    first = label(max_voxels, stop_at=2, halo=16)
    assert label(max_voxels, halo=32)[:2] == first
    assert left(tmp_path) == ["out.las"]


@pytest.mark.parametrize("name", ["tile_000001.safetensors", MANIFEST, "xyz", "cubes"])
@pytest.mark.parametrize("damage", ["cut", "gone", "other"])
def test_what_is_damaged_is_done_again(name, damage, label, undisturbed, tmp_path):
    label(300, stop_at=2)
    (path,) = tmp_path.rglob(name)
    if damage == "gone":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:-3])
    else:
        path.write_text("{}")
    label(300)
    assert (tmp_path / "out.las").read_bytes() == undisturbed
    assert left(tmp_path) == ["out.las"]


def test_a_damaged_scan_is_forgotten_before_it_is_read_again(label, tmp_path, monkeypatch):
    """Broken off then, its new arrays are as long as the old ones, but not full."""
    label(300, stop_at=1)
    (path,) = tmp_path.rglob("cubes")
    path.unlink()
    monkeypatch.setattr(tiled_scan, "read_voxels", None)
    with pytest.raises(TypeError):
        label(300)
    assert not list(tmp_path.rglob(MANIFEST))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"num_voxels": ', '"num_voxels": -', "num_voxels is no such value"),
        ('"num_voxels": ', '"num_voxels": 1000', "expected"),
        ('"num_cubes": ', '"num_cubes": 9', "expected"),
        ('"height"', '"../../height"', "features"),
        ('"version": ', '"version": 9', "version"),
        ('"unknown_codes": {', '"unknown_codes": {"none": 1', "unknown_codes"),
        ('"invalid_codes": ', '"invalid_codes": -1', "invalid_codes is no such value"),
        ('"halo_blocks"', '"halo"', "is no such value"),
    ],
)
def test_a_hostile_manifest_is_refused(old, new, message, label, tmp_path):
    label(300, stop_at=1)
    (path,) = tmp_path.rglob(MANIFEST)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(CacheError, match=message):
        open_stored(path.parent)
