"""Label real scans of seven kinds, each in a fresh process, and check that nothing was lost.

    python benchmarks/predict_real.py --model runs/NAME ../shared/data

Prints a Markdown table: points, time, peak memory, what the program warns of, and whether the
output holds all that the scan held (`bushseg verify`). Exits with 1 where it doesn't.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from bushseg.checkpoint import load_model
from bushseg.runs import find_model
from bushseg.verification import verify

# Each scan and the suffixes it is written with.
SCANS = {
    "forest/LPine1_demo.laz": (".laz",),
    "forest/bcts_1.laz": (".las",),
    "forest/autzen_test.copc.laz": (".laz",),
    "forest/pc_tree.ply": (".ply",),
    "forest/moving_ground_t0.pcd": (".ply", ".las"),
    "ign/extra_byte_bloc_350m.laz": (".laz",),
    "frames/seq00_000000.bin": (".label",),
}


def main() -> None:
    """Label every scan and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder that holds the scans")
    parser.add_argument(
        "--model", type=Path, help="a model or a run; the newest run's best if none"
    )
    arguments = parser.parse_args()
    model = find_model(arguments.model)
    scheme = load_model(model).card.scheme
    print(f"Model: {model}\n")
    print("| scan | to | points | s | points/s | peak GB | fidelity | warnings |")
    print("|---|---|---:|---:|---:|---:|---|---|")
    bad = False
    for name, suffixes in SCANS.items():
        for suffix in suffixes:
            with tempfile.TemporaryDirectory() as folder:
                scan, output = arguments.data / name, Path(folder, "labelled" + suffix)
                result = label(scan, output, model)
                if isinstance(result, str):
                    bad = True
                    print(f"| {name} | {suffix} | - | - | - | - | failed: {result} | - |")
                    continue
                wrong = verify(scan, output, scheme).differences
            bad = bad or bool(wrong)
            print(
                f"| {name} | {suffix} | {result['num_points']:,} | {result['seconds']:.1f} "
                f"| {result['points_per_second']:,.0f} | {(result['peak_memory'] or 0) / 1e9:.2f} "
                f"| {'; '.join(wrong) or 'ok'} | {'; '.join(result['warnings']) or '-'} |",
                flush=True,
            )
    sys.exit(bad)


def label(scan: Path, output: Path, model: Path) -> dict[str, Any] | str:
    """Run `bushseg predict` in a process of its own; the result, or why it failed."""
    program = str(Path(sys.executable).with_name("bushseg"))
    options = ["-o", str(output), "--model", str(model), "--json"]
    run = subprocess.run([program, "predict", str(scan), *options], capture_output=True, text=True)
    if run.returncode:
        return (run.stderr.strip().splitlines() or [f"exit status {run.returncode}"])[-1]
    result: dict[str, Any] = json.loads(run.stdout)
    return result


if __name__ == "__main__":
    main()
