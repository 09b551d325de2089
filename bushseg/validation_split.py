"""Which tiles of a data set training is judged by: whole scans or whole tiles, never points."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from bushseg.config import TrainConfig
from bushseg.errors import ConfigError


def hold_out(tiles: Mapping[int, int], scans: Sequence[str], config: TrainConfig) -> set[int]:
    """Choose tiles to hold out.

    Args:
        tiles: The number of each tile that has labels, and that of its scan.
        scans: The path of each scan.
        config: Settings: `validation`, `validation_share` and `seed`.

    Returns:
        The numbers of those held out: all of them, if that is what `validation` says.

    Raises:
        ConfigError: `validation` can't be understood, or names no scan with labels.
    """
    labelled = sorted(set(tiles.values()))
    how, share = config.validation, config.validation_share
    rng = np.random.default_rng(config.seed)
    if how.startswith("scan:"):
        wanted = [_find(name.strip(), scans) for name in how.removeprefix("scan:").split(",")]
        if bare := [scans[scan] for scan in wanted if scan not in labelled]:
            raise ConfigError(f"validation names {bare[0]}, which has no labels to judge by")
    elif how == "none" or (how == "auto" and len(tiles) < 2):
        wanted = []
    elif how == "auto" and len(labelled) > 1:
        count = min(len(labelled) - 1, max(1, round(share * len(labelled))))
        wanted = rng.permutation(labelled)[:count].tolist()
    elif how in ("tile", "auto"):
        count = min(len(tiles) - 1, max(1, round(share * len(tiles))))
        return set(rng.permutation(list(tiles))[:count].tolist())
    else:
        raise ConfigError(
            f"validation is {how!r}; expected auto, tile, none or scan:NAME[,NAME...]"
        )
    return {number for number, scan in tiles.items() if scan in wanted}


def _find(name: str, scans: Sequence[str]) -> int:
    """The scan of that path, file name or stem."""
    for number, scan in enumerate(scans):
        path = Path(scan)
        if name in (scan, path.name, path.stem):
            return number
    known = ", ".join(Path(scan).stem for scan in scans)
    raise ConfigError(f"validation names scan {name!r}; the data set holds {known}")
