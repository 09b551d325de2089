"""The real scans that models are judged on: which there are, what their codes mean, who may train.

    python benchmarks/real_scans.py ../shared/data

prints which scan may shape weights and which judges them.

The folders are those of the project's optional data folder, which isn't part of the repository. The
rule by which scans teach or judge is here, in code, so that a training recipe asks it
(:func:`may_train`) instead of keeping a list of its own.

Real labels tell fewer things apart than the `bush` scheme does: SemanticKITTI has one class for all
woody plants, surveys have bands of height. So real scans are judged by groups of our classes.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tables import print_table

from bushseg.io import find_scans
from bushseg.labels import SCHEMES

GROUPS = ("ground", "vegetation", "building", "man_made", "vehicle_person")
"""What real labels tell apart."""

GROUP_OF = {
    "ground": "ground",
    "low_vegetation": "ground",
    "bush": "vegetation",
    "tree": "vegetation",
    "building": "building",
    "man_made": "man_made",
    "vehicle_person": "vehicle_person",
}
"""The group of each of our classes. Grass and herbs go with the ground: that is where
SemanticKITTI ("terrain") and airborne surveys (2) count them."""


@dataclass(frozen=True)
class Source:
    """One collection of real scans with labels.

    Attributes:
        name: How tables call it.
        pattern: Its files, relative to the data folder.
        groups: Source code to group; codes that aren't here don't count.
        names: Source code to what it means, for tables.
        also_right: Source code to those of our classes that are right there although their group
            is another.
    """

    name: str
    pattern: str
    groups: Mapping[int, str]
    names: Mapping[int, str]
    also_right: Mapping[int, tuple[str, ...]] = field(default_factory=dict)

    def scans(self, data: Path) -> list[Path]:
        """Its files that stand in a data folder, sorted; those that may train left out."""
        return [path for path in sorted(data.glob(self.pattern)) if not may_train(path)]


def _kitti() -> tuple[dict[int, str], dict[int, str]]:
    """Groups and names of SemanticKITTI's codes."""
    groups, names = {}, {}
    for info in SCHEMES["semantickitti"].classes:
        for code in info.codes:
            groups[code] = "vegetation" if info.name == "vegetation" else GROUP_OF[str(info.bush)]
            names[code] = info.name
    return groups, names


_KITTI_GROUPS, _KITTI_NAMES = _kitti()

SOURCES = {
    source.name: source
    for source in (
        Source("frames", "frames/seq*.bin", _KITTI_GROUPS, _KITTI_NAMES),
        Source(
            "ign",
            "ign/*_*.laz",
            {2: "ground", 3: "vegetation", 4: "vegetation", 5: "vegetation", 6: "building"},
            {
                2: "ground",
                3: "vegetation to 0.5 m",
                4: "vegetation to 1.5 m",
                5: "higher vegetation",
                6: "building",
            },
            # Under half a metre, grass and herbs are what the survey calls vegetation.
            also_right={3: ("low_vegetation",)},
        ),
        Source(
            "odm",
            "odm/*.laz",
            {2: "ground", 3: "vegetation", 6: "building"},
            {2: "ground", 3: "vegetation", 6: "building"},
        ),
    )
}
"""By name. Class 3 of `odm` is vegetation of any kind, in `ign` a band of height."""


def may_train(path: Path) -> bool:
    """Whether a real scan may shape weights that are judged here.

    - `vle/` is split by area: the objects of SA1 may train; those of SA2, 37 km away, judge.
    - Of `ign/`, the six adjoining `ign_770*` judge, all of them; `KM_1` states no licence.
    - Everything else (frames, photogrammetry, forest scans) may not be trained on at all.

    Args:
        path: A scan in its folder; only the last two parts of the path matter.
    """
    folder, name = path.parent.name, path.name
    if folder == "vle":
        return name.startswith("SA1_")
    if folder == "ign":
        return not name.startswith(("ign_770", "KM_1"))
    return False


def training_scans(data: Path) -> list[Path]:
    """The real scans of a data folder that training may use, sorted."""
    found = sorted((*data.glob("vle/*.las"), *data.glob("ign/*.laz")))
    return [path for path in found if may_train(path)]


def main() -> None:
    """Print the split."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder of the real scans")
    options = parser.parse_args()
    folders = [
        folder for folder in ("vle", "ign", "frames", "odm") if (options.data / folder).is_dir()
    ]
    rows = [
        [f"{folder}/{path.name}", "may train" if may_train(path) else "judges"]
        for folder in folders
        for path in find_scans([options.data / folder])
    ]
    print_table("", ["scan", "use"], sorted(rows, key=lambda row: (row[1], row[0])))


if __name__ == "__main__":
    main()
