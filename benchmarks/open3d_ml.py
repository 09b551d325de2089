"""bushseg against Open3D-ML's RandLA-Net, on the same scans and the same cores.

    python benchmarks/open3d_ml.py ../shared/data [--model runs/NAME] [--repeats 3] [--only PART]

The first call sets Open3D-ML up in a virtual environment of its own and keeps it. Every measurement
is a fresh process that may use all cores and has warmed up on a small cloud; the sides take turns.
Printed are medians, and the ratios of the pairs that ran one after the other.

predict:  bushseg reads the scan, labels it and writes it. Open3D-ML gets the points in memory and
    leaves its labels there: its reading and writing are not counted. Four layers, K = 16, the same
    voxel size and number of classes on both sides; its crops are of 45,056 points, its default, one
    at a time, which is no slower for it than several. Time does not depend on the weights, so
    without --model they are random.
prepare:  bushseg reads, sub-samples, tiles, finds neighbors and normals, draws crops, and writes
    all of it. Of Open3D-ML only `preprocess` is counted: sub-sampling and a KD-tree, points in
    memory. Before it can train it must also write these to its cache, and it finds the neighbors,
    pools and up-sampling of each crop anew in every step.
training:  forward, loss, backward and update on one batch made beforehand, 4 crops of 12,288 points
    on both sides (a point costs Open3D-ML more in crops of 45,056).
"""

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

import laspy
import numpy as np
import torch
from open3d_ml_ours import model_at

import bushseg

HERE = Path(__file__).resolve().parent
PEER = ("open3d-cpu[ml]==0.20.0", "torch==2.13.0", "tensorboard", "libusb-package")
SCANS = {"forest/LPine1_demo.laz": 0.06, "forest/bcts_1.laz": 0.25}  # voxel sizes, metres
PREPARED_SCAN = "forest/LPine1_demo.laz"
NUM_CLASSES = bushseg.load_scheme("bush").num_classes
THREADS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
PEER_CROP_POINTS = 45_056
TRAINING = {"crop_points": 12_288, "batch_size": 4, "steps": 5, "warm_up_steps": 2}

Results = dict[str, list[dict[str, Any]]]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder that holds the scans")
    parser.add_argument("--model", type=Path, help="a model or a run; random weights if none")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", choices=("predict", "prepare", "training"))
    parser.add_argument("--peer-venv", type=Path, default=HERE / ".venv")
    options = parser.parse_args()
    peer = set_up_peer(options.peer_venv)
    print_machine(peer)
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(options.data, Path(folder), peer, options.repeats)
        if options.only in (None, "predict"):
            print_predict(bench, options.model)
        if options.only in (None, "prepare"):
            print_prepare(bench)
        if options.only in (None, "training"):
            print_training(bench)


def set_up_peer(folder: Path) -> Path:
    """Make the virtual environment unless it stands; returns its Python."""
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    done = folder / "open3d-ml.txt"
    wanted = "\n".join(PEER)
    if not done.exists() or done.read_text() != wanted:
        print(f"setting Open3D-ML up in {folder}", file=sys.stderr, flush=True)
        venv.create(folder, with_pip=True, clear=False)
        subprocess.run(
            [python, "-m", "pip", "install", "-qq", *PEER], check=True, stdout=sys.stderr
        )
        done.write_text(wanted)
    return python


class Bench:
    """Runs jobs of both sides, each in a process of its own.

    Args:
        data: Folder that holds the scans.
        scratch: Folder for what is needed on the way.
        peer: Python of Open3D-ML's environment.
        repeats: Runs of each job.
    """

    def __init__(self, data: Path, scratch: Path, peer: Path, repeats: int) -> None:
        self.data, self.scratch, self.repeats = data, scratch, repeats
        self._pythons = {"ours": Path(sys.executable), "peer": peer}

    def take_turns(self, jobs: dict[str, tuple[str, dict[str, Any]]]) -> Results:
        """Run all jobs once, then all again, as often as is wanted.

        Args:
            jobs: Name to side ("ours", "peer", "shell") and job.

        Returns:
            Name to what each run gave.
        """
        results: Results = {name: [] for name in jobs}
        for _ in range(self.repeats):
            for name, (side, job) in jobs.items():
                result = self._shell(job) if side == "shell" else self._run(side, job)
                results[name].append(result)
                print(f"{name}: {result['seconds']:.2f} s", file=sys.stderr, flush=True)
        return results

    def points(self, name: str) -> Path:
        """A scan's points as Open3D-ML's side takes them, and nothing else of it."""
        path = self.scratch / f"{Path(name).stem}.npy"
        if not path.exists():
            xyz = bushseg.read(self.data / name).xyz
            np.save(path, (xyz - xyz.min(axis=0)).astype(np.float32))
        return path

    def warm_up_scan(self, name: str) -> Path:
        """Every thousandth point of a scan."""
        path = self.scratch / f"{Path(name).stem}_small.laz"
        if not path.exists():
            scan = laspy.read(self.data / name)
            scan.points = scan.points[np.arange(0, len(scan.points), 1000)]
            scan.write(path)
        return path

    def _run(self, side: str, job: dict[str, Any]) -> dict[str, Any]:
        script = HERE / f"open3d_ml_{side}.py"
        text = json.dumps({"threads": THREADS, "num_classes": NUM_CLASSES, **job}, default=str)
        last_line = _output([self._pythons[side], script, text]).splitlines()[-1]
        result: dict[str, Any] = json.loads(last_line)
        return result

    def _shell(self, job: dict[str, Any]) -> dict[str, Any]:
        """`bushseg predict` as a user calls it, start-up included."""
        program = Path(sys.executable).with_name("bushseg")
        output = self.scratch / "labelled.las"
        command = [program, "predict", job["scan"], "-o", output, "--model", job["model"], "-q"]
        begun = time.perf_counter()
        _output([*command, "--overwrite"])
        return {"seconds": time.perf_counter() - begun}


def _output(command: Sequence[str | Path]) -> str:
    """What a command prints; whatever limits this process's threads is not handed on."""
    limits = ("OMP_", "GOMP_", "KMP_", "MKL_", "OPENBLAS_", "NUMBA_NUM")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(limits)}
    environment["OMP_NUM_THREADS"] = str(THREADS)
    run = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, env=environment
    )
    if run.returncode:
        sys.exit(f"{run.stderr[-3000:]}\nfailed with {run.returncode}: {command[0]} {command[1]}")
    return run.stdout


def print_predict(bench: Bench, source: Path | None) -> None:
    """From a scan to its labels."""
    for name, voxel_size in SCANS.items():
        ours = {"scan": bench.data / name, "model": model_at(voxel_size, bench.scratch, source)}
        theirs = {"voxel_size": voxel_size, "crop_points": PEER_CROP_POINTS, "batch_size": 1}
        small = bench.warm_up_scan(name)
        results = bench.take_turns(
            {
                "bushseg": ("ours", {"part": "predict", "warm_up_scan": small, **ours}),
                "Open3D-ML": ("peer", {"part": "predict", "points": bench.points(name), **theirs}),
                "bushseg in a shell, start-up included": ("shell", ours),
            }
        )
        num_points = results["bushseg"][0]["num_points"]
        title = f"predict {name}, {num_points:,} points, voxels of {voxel_size} m"
        print_table(title, results, "Open3D-ML", num_points)


def print_prepare(bench: Bench) -> None:
    """From a scan to what training starts from."""
    config = {"voxel_size": SCANS[PREPARED_SCAN]}
    ours = {"part": "prepare", "scan": bench.data / PREPARED_SCAN, "config": config}
    ours["warm_up_scan"] = bench.warm_up_scan(PREPARED_SCAN)
    points = bench.points(PREPARED_SCAN)
    theirs = {"part": "prepare", "points": points, "crop_points": PEER_CROP_POINTS, **config}
    results = bench.take_turns(
        {
            "bushseg, crops for two passes": ("ours", ours),
            "bushseg, one crop": ("ours", {**ours, "config": {**config, "num_crops": 1}}),
            "Open3D-ML": ("peer", theirs),
        }
    )
    title = f"prepare {PREPARED_SCAN}, voxels of {config['voxel_size']} m"
    print_table(title, results, "Open3D-ML", len(np.load(points, mmap_mode="r")))


def print_training(bench: Bench) -> None:
    """A step of training."""
    crop_points, batch_size = TRAINING["crop_points"], TRAINING["batch_size"]
    config = {"voxel_size": SCANS[PREPARED_SCAN], "crop_points": crop_points}
    job = {"part": "training", **TRAINING}
    ours = {**job, "scan": bench.data / PREPARED_SCAN}
    ours["config"] = {**config, "num_crops": batch_size}
    theirs = {**job, "points": bench.points(PREPARED_SCAN), **config}
    results = bench.take_turns(
        {
            "bushseg, BushNet": ("ours", {**ours, "network": "BushNet"}),
            "bushseg, BushNet, --precision auto": (
                "ours",
                {**ours, "network": "BushNet", "precision": "auto"},
            ),
            "bushseg, RandLA-Net": ("ours", {**ours, "network": "RandLA-Net"}),
            "Open3D-ML, RandLA-Net": ("peer", theirs),
        }
    )
    title = f"training step, {batch_size} crops of {crop_points:,} points"
    print_table(title, results, "Open3D-ML, RandLA-Net", batch_size * crop_points)


def print_table(title: str, results: Results, peer: str, num_points: int) -> None:
    """One line a program: medians, every run, and how many times as fast as the peer it was.

    Args:
        title: What was measured.
        results: Program to its runs.
        peer: Which of them the others are held against.
        num_points: What all of them worked through.
    """
    print(f"\n### {title}\n")
    print("| program | voxels | passes | s | runs, s | points/s | times as fast (range) |")
    print("|---|---:|---:|---:|---|---:|---|")
    for program, runs in results.items():
        seconds = [run["seconds"] for run in runs]
        pairs = zip(seconds, results[peer], strict=True)
        ratios = sorted(theirs["seconds"] / ours for ours, theirs in pairs)
        cells = (
            program,
            f"{runs[0]['num_voxels']:,}" if "num_voxels" in runs[0] else "",
            f"{runs[0]['passes']:.2f}" if "passes" in runs[0] else "",
            f"{median(seconds):.2f}",
            ", ".join(f"{value:.2f}" for value in seconds),
            f"{num_points / median(seconds):,.0f}",
            f"{median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})",
        )
        print("| " + " | ".join(cells) + " |")
    print()
    for program, runs in results.items():
        if stages := runs[0].get("stages"):
            parts = (
                f"{name} {median(run['stages'][name] for run in runs):.2f} s" for name in stages
            )
            print(f"- {program}: {', '.join(parts)}")
    sys.stdout.flush()


def print_machine(peer: Path) -> None:
    """What ran where and when."""
    model = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((x.split(": ")[1] for x in lines if x.startswith("model name")), model)
    asked = "import torch, numpy; print('torch', torch.__version__, 'numpy', numpy.__version__)"
    print(
        f"{datetime.date.today()}, {THREADS} cores of {model}, Python {platform.python_version()}"
    )
    if hasattr(os, "getloadavg"):
        print(f"load before the run: {os.getloadavg()[0]:.2f}")
    print(f"bushseg {version('bushseg')}: torch {torch.__version__}, numpy {np.__version__}")
    print(f"Open3D-ML of {PEER[0]}: {_output([peer, '-c', asked]).strip()}", flush=True)


if __name__ == "__main__":
    main()
