"""How long the command line takes to start.

    python benchmarks/start.py [--starts 21]

Each command is started in a fresh process as often as asked, in turn with the others, and once
before that without being counted: the first start of all also writes byte code. `python -c pass` is
what no program in Python can do without.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

BUSHSEG = str(Path(sys.executable).with_name("bushseg"))
COMMANDS = {
    "python -c pass": [sys.executable, "-c", "pass"],
    'python -c "import bushseg"': [sys.executable, "-c", "import bushseg"],
    "bushseg --help": [BUSHSEG, "--help"],
    "bushseg --version": [BUSHSEG, "--version"],
    "bushseg predict --help": [BUSHSEG, "predict", "--help"],
    "bushseg labels": [BUSHSEG, "labels"],
}


def seconds(command: list[str]) -> float:
    """Time of one fresh process, from its start to its end."""
    begun = time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - begun


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--starts", type=int, default=21)
    options = parser.parse_args()
    for command in COMMANDS.values():
        seconds(command)
    rounds = [[seconds(command) for command in COMMANDS.values()] for _ in range(options.starts)]
    print(f"Python {sys.version.split()[0]}, {options.starts} starts each")
    print("| command | median, s | 10 %, s | 90 %, s |\n|---|---|---|---|")
    for name, times in zip(COMMANDS, np.transpose(rounds), strict=True):
        low, middle, high = np.quantile(times, (0.1, 0.5, 0.9))
        print(f"| `{name}` | {middle:.3f} | {low:.3f} | {high:.3f} |")


if __name__ == "__main__":
    main()
