"""How many painted points buy how much: a model trained on, on a site of which little is labelled.

    python benchmarks/fine_tuning.py SITE.laz ... --from MODEL --output OUT
        [--points 0,100,300,1000,3000,10000] [--seeds 3] [--epochs 10] [--scratch]

Each labelled site is cut in two by its middle, west and east. In the west some points are
"painted": balls of 0.3 m about random points, as a brush would, every other one on bush; all other
labels are erased. The model is trained on from there and judged on the east, which it never sees,
two metres at the cut left out. `--scratch` trains a new network of the same settings on the same
points beside it. All settings but those named are the model's own. Finished runs in OUT are not
trained again.
"""

import argparse
import tempfile
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from ablation import judge_sites, spread
from judging import BUSH, BUSH_LABEL, Network
from numpy.typing import NDArray
from tables import print_table

import bushseg
from bushseg.config import Config
from bushseg.io import find_scans
from bushseg.runs import LAST, METRICS

BRUSH = 0.3
"""Radius of a stroke, metres."""

GAP = 2.0
"""Strip at the cut that belongs to neither half, metres."""


class Halves(NamedTuple):
    """A site cut in two.

    Attributes:
        train: The west, all labels in place; some of them are erased for a run.
        test: The east.
    """

    train: Path
    test: Path


def main() -> None:
    """Paint, train, judge and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("sites", type=Path, nargs="+", help="labelled LAS or LAZ")
    parser.add_argument("--from", dest="model", required=True, help="one, or a run")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--points", default="0,100,300,1000,3000,10000")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--epochs", type=int, default=10)
    parser.add_argument("--scratch", action="store_true", help="train a new network as well")
    options = parser.parse_args()
    network = Network(options.model)
    amounts = [int(number) for number in options.points.split(",")]
    rows: list[list[object]] = []
    with tempfile.TemporaryDirectory() as folder:
        halves = [cut(path, Path(folder)) for path in find_scans(options.sites)]
        tests = [half.test for half in halves]
        for start in ("model", "scratch") if options.scratch else ("model",):
            for amount in amounts:
                if amount == 0:
                    if start == "model":
                        confusion = judge_sites(network, tests)
                        bush = float(confusion.iou[BUSH_LABEL])
                        rows.append(["as it is", 0, 0, spread([bush]), spread([confusion.miou])])
                    continue
                scores = []
                for seed in range(options.seeds):
                    painted = Path(folder, f"painted-{amount}-{seed}")
                    strokes = sum(
                        paint(half.train, painted / half.train.name, amount // len(halves), seed)
                        for half in halves
                    )
                    run = options.output / f"{start}-{amount}-{seed}"
                    tune(painted, run, network, options.epochs, seed, scratch=start == "scratch")
                    confusion = judge_sites(Network(run / LAST), tests)
                    scores.append((float(confusion.iou[BUSH_LABEL]), confusion.miou))
                    print(f"{start}, {amount} points, seed {seed}: {scores[-1][0]:.3f}", flush=True)
                bushes, means = (list(column) for column in zip(*scores, strict=True))
                name = "trained on" if start == "model" else "from scratch"
                rows.append([name, amount, strokes, spread(bushes), spread(means)])
    print_table(
        f"{len(tests)} sites, judged on the half never seen",
        ["network", "painted points", "strokes", "bush IoU", "mIoU"],
        rows,
    )


def cut(path: Path, folder: Path) -> Halves:
    """Write the western and the eastern half of a site into a folder."""
    las = laspy.read(path)
    x = np.asarray(las.x)
    middle = float(np.median(x))
    halves = Halves(folder / "west" / f"{path.stem}.laz", folder / "east" / f"{path.stem}.laz")
    for target, chosen in zip(halves, (x < middle - GAP / 2, x > middle + GAP / 2), strict=True):
        target.parent.mkdir(parents=True, exist_ok=True)
        part = laspy.LasData(las.header)
        part.points = las.points[chosen]
        part.write(target)
    return halves


def paint(source: Path, target: Path, num_points: int, seed: int) -> int:
    """Copy a scan with all labels erased but those under some strokes of a brush.

    Args:
        source: A labelled scan.
        target: The copy.
        num_points: Points that keep their label; a stroke is cut short where they are reached.
        seed: Of the strokes' places.

    Returns:
        The number of strokes.
    """
    las = laspy.read(source)
    labels = BUSH.encode(np.asarray(las.classification)).labels
    kept, num_strokes = strokes(np.asarray(las.xyz), labels, num_points, seed)
    codes = np.full(len(labels), BUSH.unlabelled[0], np.uint8)
    codes[kept] = np.asarray(las.classification)[kept]
    las.classification = codes
    target.parent.mkdir(parents=True, exist_ok=True)
    las.write(target)
    return num_strokes


def strokes(
    xyz: NDArray[np.float64], labels: NDArray[np.int16], num_points: int, seed: int
) -> tuple[NDArray[np.intp], int]:
    """Points under strokes about random labelled points, every other one on bush.

    Returns:
        Their indices, at most `num_points`, and how many strokes it took.
    """
    rng = np.random.default_rng(seed)
    bush, rest = (
        np.flatnonzero(labels == BUSH_LABEL),
        np.flatnonzero((labels >= 0) & (labels != BUSH_LABEL)),
    )
    found: NDArray[np.intp] = np.empty(0, np.intp)
    number = 0
    while len(found) < min(num_points, len(bush) + len(rest)):
        pool = bush if number % 2 == 0 and len(bush) else rest
        center = xyz[rng.choice(pool if len(pool) else bush)]
        near = np.flatnonzero((np.linalg.norm(xyz - center, axis=1) <= BRUSH) & (labels >= 0))
        new = near[~np.isin(near, found)]
        found = np.concatenate([found, rng.permutation(new)[: num_points - len(found)]])
        number += 1
    return found, number


def is_finished(run: Path, epochs: int) -> bool:
    """Whether a run of so many epochs stands there already: its metrics have a row for each."""
    metrics = run / METRICS
    return metrics.exists() and len(metrics.read_text("utf-8").splitlines()) == epochs + 1


def tune(
    scans: Path, run: Path, network: Network, epochs: int, seed: int, *, scratch: bool
) -> None:
    """Train on from a model, or a new network of its settings, on scans of few labels."""
    if is_finished(run, epochs):
        return
    card = network.known[0].card
    config = Config().model_copy(update={"prepare": card.prepare, "network": card.network})
    train = config.train.model_copy(update={"epochs": epochs, "seed": seed, "validation": "none"})
    config = config.model_copy(update={"train": train})
    with tempfile.TemporaryDirectory() as folder:
        bushseg.prepare([scans], folder, config.prepare)
        start = {} if scratch else {"pretrained": network.name}
        bushseg.train(folder, run, config, overwrite=True, **start)


if __name__ == "__main__":
    main()
