"""Make a bundled model: simulate sites, prepare them, train, and put the result into the package.

    PYTHONPATH=benchmarks python recipes/make_model.py close --work build/models [--data DATA]

Everything is seeded, and what stands in the work folder already is kept, so that a stopped run goes
on. With --data, the folder of real scans, those that may teach take part in the airborne model.
`--only sites` stops before training; `test` is no model but the sites that judge both.
"""

import argparse
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from real import write_plantings, write_real_scans
from sites import TEST, TRAINING

import bushseg
from bushseg.checkpoint import read_card
from bushseg.config import Config
from bushseg.errors import DataError
from bushseg.io import find_scans, read
from bushseg.parallel import num_workers
from bushseg.progress import Silent
from bushseg.runs import BEST, LAST
from bushseg.simulation import SimulateConfig, simulate
from bushseg.simulation.scene import CLASS_CODES

ROOT = Path(__file__).resolve().parent.parent
PURPOSES = {
    "close": "tripods, mobile mapping, LiDAR frames and low drones",
    "airborne": "surveys from aircraft and high drones",
}

LEAST_FOLDER = 4
"""Folders of fewer scans teach only."""

ENOUGH_POINTS = 300
"""So many points of a class make a scan one that holds it."""


def main() -> None:
    """Read the options and do what is left to do."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("name", choices=(*TRAINING, "test"))
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "models")
    parser.add_argument("--data", type=Path, help="folder of real scans")
    parser.add_argument("--only", choices=("sites",))
    options = parser.parse_args()
    sites = TEST if options.name == "test" else TRAINING[options.name]
    scans = make_sites(options.work / options.name, sites)
    if options.only is None and options.name != "test":
        held_out = richest_sites(scans)
        again = f"{options.name}_again"
        prepared = options.work / f"{options.name}-prepared"
        real = options.data if options.name == "airborne" else None
        if real is not None:
            scans.append(write_real_scans(real, options.work / "real"))
        first = train(options.name, scans, held_out, prepared)
        if real is not None:
            scans.append(write_plantings(real, options.work / "plantings"))
            prepared = options.work / f"{again}-prepared"  # the first round's stays as it is
        second = train(again, scans, held_out, prepared, first)
        bundle(options.name, max(first, second, key=held_out_score))


def make_sites(folder: Path, sites: dict[str, SimulateConfig]) -> list[Path]:
    """Simulate what isn't there yet, a process a core; returns the folders of scans."""
    with ProcessPoolExecutor(num_workers()) as pool:
        calls = [
            pool.submit(_simulate, folder / name, config)
            for name, config in sites.items()
            if _num_sites(folder / name) < config.num_sites
        ]
        for call in calls:
            call.result()
    return [folder / name for name in sites]


def _num_sites(folder: Path) -> int:
    return len({path.stem[: len("site_000")] for path in folder.glob("site_*")})


def _simulate(folder: Path, config: SimulateConfig) -> None:
    simulate(folder, config)
    print(f"{folder}: {config.num_sites} sites", flush=True)


def richest_sites(folders: list[Path]) -> list[Path]:
    """What each epoch is judged by and confidence is calibrated on: a twelfth of most folders.

    Of folders of four scans and more those that hold most classes, the later of equals, so that no
    class is judged by nothing.

    Raises:
        DataError: A class is in none of them.
    """
    held_out: list[Path] = []
    seen: set[int] = set()
    for folder in folders:
        found = find_scans([folder])
        if len(found) < LEAST_FOLDER:
            continue
        held = {path: classes_of(path) for path in found}
        ranked = sorted(found, key=lambda path: (len(held[path]), path.name))
        chosen = ranked[-max(1, len(found) // 12) :]
        held_out += chosen
        seen.update(*(held[path] for path in chosen))
    missing = [name for name, code in CLASS_CODES.items() if code not in seen]
    if missing:
        raise DataError(
            f"no held-out site holds {', '.join(missing)}; expected every class; "
            "simulate more sites in recipes/sites.py"
        )
    return held_out


def classes_of(path: Path) -> set[int]:
    """The codes of which a scan has points enough to judge by."""
    columns = read(path).attributes
    codes = columns["label" if "label" in columns else "classification"]
    found, counts = np.unique(codes, return_counts=True)
    return {int(code) for code in found[counts >= ENOUGH_POINTS]}


def train(
    name: str, scans: list[Path], held_out: list[Path], prepared: Path, first: Path | None = None
) -> Path:
    """Prepare and train as NAME.toml says, from a first run's best weights if there is one.

    Goes on with a run that was stopped.

    Returns:
        The run.
    """
    settings: dict[str, Any] = {"validation": f"scan:{','.join(map(str, held_out))}"}
    if first is not None:
        settings["pretrained"] = str(first / BEST)
    config = Config.load(ROOT / "recipes" / f"{name}.toml", {"train": settings})
    run = prepared.with_name(f"{name}-run")
    bushseg.prepare(scans, prepared, config.prepare)
    bushseg.train(prepared, run, config, resume=(run / LAST).exists(), progress=Lines())
    return run


def held_out_score(run: Path) -> float:
    """Best mean IoU on the held-out sites, that of the model a run keeps."""
    score = read_card(run / BEST).metrics["val_miou"]
    return -1.0 if score is None else score


class Lines(Silent):
    """Prints what training notes, a line an epoch."""

    def note(self, message: str) -> None:
        """Print it."""
        print(message, flush=True)


def bundle(name: str, run: Path) -> None:
    """Store the run's best model in the package."""
    tool = ROOT / "tools" / "bundle_model.py"
    command = [sys.executable, tool, run, "--name", name, "--purpose", PURPOSES[name]]
    subprocess.run(command, check=True)


if __name__ == "__main__":
    main()
