"""What is held out, of three scans with two tiles each."""

import pytest

from bushseg.config import TrainConfig
from bushseg.errors import ConfigError
from bushseg.validation_split import hold_out

SCANS = ["site/middle.las", "site/north.las", "site/south.las"]
TILES = {0: 0, 1: 0, 2: 1, 3: 1, 4: 2, 5: 2}


def held(validation: str, tiles: dict[int, int] = TILES, **settings: object) -> set[int]:
    return hold_out(tiles, SCANS, TrainConfig(validation=validation, **settings))


@pytest.mark.parametrize("name", ["south", "south.las", "site/south.las", " south "])
def test_a_scan_by_its_name(name: str) -> None:
    assert held(f"scan:{name}") == {4, 5}


def test_several_scans() -> None:
    assert held("scan:north, middle") == {0, 1, 2, 3}


@pytest.mark.parametrize("seed", range(5))
def test_auto_holds_a_whole_scan(seed: int) -> None:
    assert held("auto", seed=seed) in ({0, 1}, {2, 3}, {4, 5})


@pytest.mark.parametrize("seed", range(5))
def test_auto_holds_a_tile_of_a_single_scan_and_none_of_a_single_tile(seed: int) -> None:
    assert held("auto", {3: 1, 7: 1}, seed=seed) in ({3}, {7})
    assert held("auto", {3: 1}, seed=seed) == set()


def test_tiles_by_the_share_asked_for() -> None:
    assert len(held("tile", validation_share=0.5)) == 3
    assert held("tile", validation_share=0.5) == held("tile", validation_share=0.5)
    assert len({frozenset(held("tile", seed=seed)) for seed in range(9)}) > 1
    assert len(held("tile", validation_share=1.0)) == 5  # one is left to train on


def test_none_holds_nothing() -> None:
    assert held("none") == set()


@pytest.mark.parametrize("validation", ["scan:east", "scan:", "half", ""])
def test_what_can_t_be_understood(validation: str) -> None:
    with pytest.raises(ConfigError, match="validation"):
        held(validation)


def test_an_unknown_scan_is_told_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"'east'.*middle, north, south"):
        held("scan:east")


def test_a_scan_without_labels_judges_nothing() -> None:
    with pytest.raises(ConfigError, match=r"site/south\.las, which has no labels"):
        held("scan:south", {0: 0, 2: 1})
