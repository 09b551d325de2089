"""A scan's tiles: the same bytes wherever its voxels are, and however often a run is broken off."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from bushseg import scan_tiles, voxel_normals
from bushseg.cache import read_json
from bushseg.config import PrepareConfig
from bushseg.errors import WriteError
from bushseg.labels import load_scheme
from bushseg.prepared import MANIFEST, SCRATCH
from bushseg.scan_tiles import finished_tiles, write_tiles

FEW, MANY = 300, 10**9
SCHEME = "rellis"  # it knows bushes and walls by the codes they have here, and the ground not


@pytest.fixture
def config(tiny) -> PrepareConfig:
    return tiny().prepare.model_copy(update={"tile_points": 1000, "scheme": SCHEME})


@pytest.fixture
def place(tmp_path) -> Path:
    return tmp_path / "scan-0"


@pytest.fixture
def prepare(scans, config, place, monkeypatch) -> Callable[..., tuple[int, int]]:
    """Writes a scan's tiles; says how many pieces' normals and how many tiles were made for it."""
    monkeypatch.setattr(voxel_normals, "_TILE_POINTS", 700)
    estimate, save = voxel_normals.estimate_normals, scan_tiles.save_tile

    def run(
        max_voxels: int = FEW, *, pieces: int | None = None, tiles: int | None = None
    ) -> tuple[int, int]:
        done = {"pieces": 0, "tiles": 0}

        def counted(name: str, most: int | None, honest: Callable) -> Callable:
            def call(*args):
                if done[name] == most:
                    raise KeyboardInterrupt
                done[name] += 1
                return honest(*args)

            return call

        monkeypatch.setattr(voxel_normals, "estimate_normals", counted("pieces", pieces, estimate))
        monkeypatch.setattr(scan_tiles, "save_tile", counted("tiles", tiles, save))
        try:
            write_tiles(scans / "south.las", place, config, load_scheme(SCHEME), max_voxels)
        except KeyboardInterrupt:
            assert (pieces, tiles) != (None, None)
        return done["pieces"], done["tiles"]

    return run


@pytest.fixture
def undisturbed(prepare, place, contents) -> dict[str, bytes]:
    pieces, tiles = prepare(MANY)
    assert min(pieces, tiles) > 3
    found = contents(place)
    assert len(found) == tiles + 1
    manifest = read_json(place / MANIFEST)
    assert manifest["unknown_codes"] == {"2": 2000}
    assert any(any(tile["class_counts"]) for tile in manifest["tiles"])
    shutil.rmtree(place)
    return found


def test_the_same_bytes_wherever_voxels_are(prepare, place, undisturbed, contents):
    prepare(FEW)
    assert contents(place) == undisturbed
    assert not (place / SCRATCH).exists()


@pytest.mark.parametrize("first", [{"pieces": 0}, {"pieces": 2}, {"tiles": 0}, {"tiles": 2}])
def test_what_is_done_is_not_done_again(first, prepare, place, undisturbed, monkeypatch, contents):
    whole = prepare()
    shutil.rmtree(place)
    done = prepare(**first)
    assert finished_tiles(place) is None
    monkeypatch.setattr(scan_tiles, "read_voxels", None)
    rest = prepare(MANY)
    assert (done[0] + rest[0], done[1] + rest[1]) == whole
    assert contents(place) == undisturbed


def test_what_stands_is_left_as_it_is(prepare, place, undisturbed, contents):
    prepare(MANY)
    assert prepare(MANY) == (0, 0)
    assert contents(place.parent) == {
        f"{place.name}/{name}": raw for name, raw in undisturbed.items()
    }


def test_broken_off_again_and_again(prepare, place, undisturbed, contents):
    for limits in ({"pieces": 1},) * 3 + ({"pieces": 0}, {"tiles": 0}) + ({"tiles": 1},) * 2:
        prepare(**limits)
        assert not (place / MANIFEST).exists()
    _, tiles = prepare()
    assert tiles == len(undisturbed) - 3
    assert contents(place) == undisturbed


def test_in_memory_it_is_done_again(prepare, place, undisturbed, contents):
    prepare(MANY, tiles=2)
    assert prepare(MANY)[1] == len(undisturbed) - 1
    assert contents(place) == undisturbed


def test_what_killed_runs_leave_beside_it_is_removed(prepare, place, undisturbed, contents):
    prepare(tiles=2)
    (place / ".tile_0002-abcd1234.partial.safetensors").write_text("half")
    prepare()
    assert contents(place) == undisturbed
    (place / SCRATCH).mkdir()
    (place / SCRATCH / "xyz").write_text("killed while it tidied up")
    manifest = finished_tiles(place)
    assert manifest == read_json(place / MANIFEST)
    assert contents(place) == undisturbed


@pytest.mark.parametrize("damage", ["cut", "gone", "other"])
@pytest.mark.parametrize(
    "name",
    [
        "tile_0001.safetensors",
        f"{SCRATCH}/tile_0001.safetensors.json",
        f"{SCRATCH}/scan.json",
        f"{SCRATCH}/normals.json",
        f"{SCRATCH}/normals",
        f"{SCRATCH}/xyz",
        f"{SCRATCH}/cubes",
    ],
)
def test_what_is_damaged_is_done_again(name, damage, prepare, place, undisturbed, contents):
    prepare(tiles=2)
    path = place / name
    if damage == "gone":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:-3])
    else:
        path.write_text("{}")
    prepare()
    assert contents(place) == undisturbed


def test_a_damaged_scan_takes_nothing_along(prepare, place, undisturbed, contents):
    """Broken off once more while it is read again: what was noted of the old one is gone."""
    prepare(tiles=2)
    (place / SCRATCH / "cubes").unlink()
    prepare(pieces=0)
    assert not list(place.rglob("tile_*"))
    prepare()
    assert contents(place) == undisturbed


def test_a_full_disk(scans, config, place, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda _: shutil._ntuple_diskusage(10, 10, 0))
    with pytest.raises(WriteError, match=r"work on another disk: .*--output of prepare"):
        write_tiles(scans / "south.las", place, config, load_scheme(SCHEME), FEW)
