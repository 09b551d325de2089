"""Single airborne objects that someone called bush, hedge or tree: the `vle` folder.

One object a file, cut out without the ground it stands on. A model that is given the object alone
must take its lowest points for the ground; so each is judged a second time on a flat ground that is
made up at the height of its lowest point. What hangs above the true ground, as the crown of a tree
without its trunk, stands too low in both.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from judging import NAMES, Labeler, Scan, read_scan
from numpy.typing import NDArray
from real_scans import may_train

from bushseg.points import PointCloud

KINDS = {"Bush": "bush", "Hedgerow": "bush", "Tree": "tree"}
"""Kind of object to the class its points should get. Woody edges, tree lines and groups hold both
and are listed but not scored."""

LOW = 6.0
"""Metres. What is called a hedgerow there reaches 15 m: rows of trees among them. Objects no higher
than a bush grows are therefore scored once more by themselves."""

MARGIN = 6.0
"""How far the made-up ground reaches beyond the object, metres."""

SPACING = 0.25
"""Between the made-up ground's points, metres: 16 points a square metre, as the survey had."""

ROUGHNESS = 0.03
"""Standard deviation of the made-up ground's heights, metres."""


@dataclass(frozen=True)
class Verdict:
    """What a labeler said of one object.

    Attributes:
        name: The file's stem.
        kind: "Bush", "Hedgerow", "Tree", ...
        height: From its lowest to its highest point, metres.
        counts: Points called each class, (7,) int64.
    """

    name: str
    kind: str
    height: float
    counts: NDArray[np.int64]

    @property
    def truth(self) -> str | None:
        """The class its points should get, None where that isn't settled."""
        return KINDS.get(self.kind)

    @property
    def share(self) -> float:
        """Share of its points that are called bush."""
        return float(self.counts[NAMES.index("bush")] / self.counts.sum())

    @property
    def majority(self) -> str:
        """The class most of its points are called."""
        return NAMES[int(self.counts.argmax())]


def held_out_objects(data: Path) -> list[Path]:
    """The objects no model has trained on: those of SA2."""
    return [path for path in sorted(data.glob("vle/*.las")) if not may_train(path)]


def judge_objects(
    labeler: Labeler, paths: Sequence[Path], *, grounded: bool, kinds: Sequence[str] = ()
) -> list[Verdict]:
    """Have objects labelled, each by itself.

    Args:
        labeler: Who labels.
        paths: The objects.
        grounded: Whether they are set on a made-up ground.
        kinds: Which kinds; all if empty.
    """
    verdicts = []
    for path in paths:
        kind = path.stem.split("_")[1]
        if kinds and kind not in kinds:
            continue
        scan = read_scan(path)
        num_points, z = len(scan.cloud), scan.cloud.xyz[:, 2]
        probabilities = labeler.label(set_on_ground(scan) if grounded else scan)[:num_points]
        counts = np.bincount(probabilities.argmax(axis=1), minlength=len(NAMES))
        verdicts.append(Verdict(path.stem, kind, float(np.ptp(z)), counts))
    return verdicts


def set_on_ground(scan: Scan) -> Scan:
    """Add a flat ground behind an object's points, as bright as the object and as dense.

    Of the attributes only intensity is kept.
    """
    rng = np.random.default_rng(0)
    low, high = scan.cloud.xyz.min(axis=0), scan.cloud.xyz.max(axis=0)
    steps = [np.arange(low[i] - MARGIN, high[i] + MARGIN, SPACING) for i in range(2)]
    xy = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    xy += rng.uniform(-0.5, 0.5, xy.shape) * SPACING
    ground = np.column_stack([xy, low[2] + ROUGHNESS * rng.standard_normal(len(xy))])
    attributes = {}
    if "intensity" in scan.cloud.attributes:
        own = scan.cloud.attributes["intensity"]
        attributes["intensity"] = np.concatenate([own, rng.choice(own, len(ground))])
    cloud = PointCloud(np.concatenate([scan.cloud.xyz, ground]), attributes)
    codes = np.concatenate([scan.codes, np.full(len(ground), -1)])
    return Scan(scan.path, cloud, codes, None, None)


@dataclass(frozen=True)
class ObjectScores:
    """Objects of both classes, summed up.

    Attributes:
        bush_iou: Per point, bush against tree: all points of bushes and hedges are bush, all of
            trees tree; any other prediction is a miss.
        tree_iou: Likewise.
        bushes_right: Share of bushes and hedges most of whose points are called bush.
        trees_right: Share of trees most of whose points are called tree.
    """

    bush_iou: float
    tree_iou: float
    bushes_right: float
    trees_right: float


def score_objects(verdicts: Sequence[Verdict]) -> ObjectScores:
    """Sum up verdicts; objects without a settled class don't count."""
    ious, right = [], []
    for name in ("bush", "tree"):
        label = NAMES.index(name)
        own = [verdict for verdict in verdicts if verdict.truth == name]
        others = [verdict for verdict in verdicts if verdict.truth not in (name, None)]
        hits = sum(int(verdict.counts[label]) for verdict in own)
        false = sum(int(verdict.counts[label]) for verdict in others)
        total = sum(int(verdict.counts.sum()) for verdict in own)
        ious.append(hits / (total + false) if total + false else float("nan"))
        wins = [verdict.majority == name for verdict in own]
        right.append(float(np.mean(wins)) if wins else float("nan"))
    return ObjectScores(*ious, *right)
