"""What models do on scans they never saw: real ones first, then simulated ones.

    python benchmarks/transfer.py ../shared/data --model runs/NAME [--model MODEL ...]
        [--simulated SITES ...] [--without intensity] [--without rgb,intensity]
        [--only frames,ign,odm,vle,simulated] [--json FILE]

Which real scans may train and which judge is settled in `real_scans.py`; only the latter are read.
The summary at the end begins with what the first model is worst at.
"""

import argparse
import json
import time
from pathlib import Path

from judging import Network, Without
from reporting import report


def main() -> None:
    """Judge and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("data", type=Path, help="folder of the real scans")
    parser.add_argument(
        "--model", action="append", required=True, help="a model, a run, a bundled one"
    )
    parser.add_argument(
        "--simulated", type=Path, nargs="+", default=[], help="simulated scans, or their folders"
    )
    parser.add_argument(
        "--without", action="append", default=[], help="judge each model without these as well"
    )
    parser.add_argument("--json", type=Path, help="write the summary there, too")
    parser.add_argument("--only", default="", help="frames, ign, odm, vle, simulated; all")
    options = parser.parse_args()
    begun = time.perf_counter()
    networks = [Network(source) for source in options.model]
    for network in networks:
        for model in network.known:
            print(f"{network.name}: {model.name}, voxels of {model.card.prepare.voxel_size} m")
    only = [name for name in options.only.split(",") if name]
    blinded = [
        Without(network, names.split(",")) for network in networks for names in options.without
    ]
    result = report([*networks, *blinded], options.data, options.simulated, only)
    if options.json is not None:
        options.json.write_text(json.dumps(result.as_dict(), indent=1) + "\n", "utf-8")
    print(f"\n{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
