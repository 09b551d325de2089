"""BushNet against RandLA-Net's features, and each of BushNet's parts taken away, over seeds.

    python benchmarks/ablation.py --train SITES ... --test SITES ... --output OUT
        [--config FILE] [--seeds 3] [--variants BushNet,RandLA-Net]

All variants get the same scans, crops, epochs and steps, and the widths of the settings' network.
The model judged is the last one, not the best: nothing is chosen by the data it is judged on. What
is finished is kept in OUT and not trained again, so the command can be repeated after a stop.
"""

import argparse
import json
import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from judging import BUSH_LABEL, Judged, Network, read_scan
from scoring import class_confusion
from tables import print_table

import bushseg
from bushseg.checkpoint import load_model
from bushseg.config import Config, Sampling
from bushseg.files import atomic_path
from bushseg.io import find_scans
from bushseg.metrics import ConfusionMatrix
from bushseg.models.bushnet import count_parameters
from bushseg.runs import LAST

RESULT = "result.json"


class Variant(NamedTuple):
    """A way to build and feed the network.

    Attributes:
        network: Settings that differ from BushNet's.
        sampling: How layers are decimated.
    """

    network: dict[str, Any]
    sampling: Sampling = "mrs"


_RANDLA = {"spf": False, "attention": "randla", "position": "absolute"}
VARIANTS = {
    "BushNet": Variant({}),
    "RandLA-Net": Variant(_RANDLA, "random"),
    "without SPF": Variant({"spf": False}),
    "without MAM": Variant({"attention": "randla"}),
    "without MRS": Variant({}, "random"),
}


@dataclass(frozen=True)
class Scores:
    """What one run came to on the test sites.

    Attributes:
        bush_iou: IoU of bush.
        miou: Mean IoU over the classes.
    """

    bush_iou: float
    miou: float


def main() -> None:
    """Train, judge and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--train", type=Path, nargs="+", required=True)
    parser.add_argument("--test", type=Path, nargs="+", required=True)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--config", type=Path, help="settings, as bushseg.toml has them")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--variants", default=",".join(VARIANTS))
    options = parser.parse_args()
    config = Config.load(options.config)
    names = options.variants.split(",")
    scores: dict[str, list[Scores]] = {name: [] for name in names}
    sizes: dict[str, int] = {}
    # Seed by seed, so that a run that is broken off has compared all variants.
    for seed in range(options.seeds):
        for name in names:
            folder = options.output / f"{name.replace(' ', '-')}-{seed}"
            own = variant_config(config, VARIANTS[name], seed)
            train(options.train, options.output, folder, own)
            scores[name].append(judge(folder, options.test, own))
            sizes[name] = count_parameters(load_model(folder / LAST).network)["total"]
            print(f"{name}, seed {seed}: bush IoU {scores[name][-1].bush_iou:.3f}", flush=True)
    rows = []
    for name in names:
        bush, mean = ([getattr(one, key) for one in scores[name]] for key in ("bush_iou", "miou"))
        gaps = [one - other.bush_iou for one, other in zip(bush, scores[names[0]], strict=True)]
        rows.append([name, sizes[name], spread(bush), spread(gaps), spread(mean), len(bush)])
    print_table(
        f"On {len(find_scans(options.test))} test scans: mean and standard deviation over seeds",
        ["network", "parameters", "bush IoU", f"less that of {names[0]}", "mIoU", "seeds"],
        rows,
    )


def variant_config(config: Config, variant: Variant, seed: int) -> Config:
    """Settings of one run."""
    return config.model_copy(
        update={
            "prepare": config.prepare.model_copy(update={"sampling": variant.sampling}),
            "network": config.network.model_copy(update=variant.network),
            "train": config.train.model_copy(update={"seed": seed}),
        }
    )


def train(scans: list[Path], output: Path, folder: Path, config: Config) -> None:
    """Train a run unless it is finished; go on with one that was broken off."""
    if (folder / RESULT).exists():
        return
    prepared = output / f"prepared-{config.prepare.sampling}"
    bushseg.prepare(scans, prepared, config.prepare)
    bushseg.train(prepared, folder, config, resume=(folder / LAST).exists())


def judge(folder: Path, scans: list[Path], config: Config) -> Scores:
    """The last model's scores on test scans, kept beside it.

    Raises:
        SystemExit: The folder's scores are of other settings or scans.
    """
    paths = find_scans(scans)
    asked = {
        "settings": config.model_dump(mode="json"),
        "scans": [str(path) for path in paths],
    }
    kept = folder / RESULT
    if kept.exists():
        values = json.loads(kept.read_text("utf-8"))
        if values["asked"] != asked:
            raise SystemExit(
                f"{folder}: holds a run of other settings or scans; name another --output"
            )
        return Scores(**values["scores"])
    confusion = judge_sites(Network(folder / LAST), paths)
    scores = Scores(float(confusion.iou[BUSH_LABEL]), confusion.miou)
    with atomic_path(kept) as partial:
        partial.write_text(json.dumps({"asked": asked, "scores": vars(scores)}, indent=1), "utf-8")
    return scores


def judge_sites(network: Network, paths: list[Path]) -> ConfusionMatrix:
    """One confusion matrix over all points of some labelled scans."""
    parts = [class_confusion(Judged.of(network, read_scan(path))) for path in paths]
    return sum(parts[1:], parts[0])


def spread(values: list[float]) -> str:
    """Mean and standard deviation."""
    if len(values) < 2:
        return f"{np.mean(values):.3f}"
    return f"{np.mean(values):.3f} ± {statistics.stdev(values):.3f}"


if __name__ == "__main__":
    main()
