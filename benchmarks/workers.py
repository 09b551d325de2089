"""How long does a scan take with several worker processes?

    python benchmarks/workers.py SCAN [--model NAME] [--workers 1,2,4] [--tile-points 500000]

Labels the scan with each number of processes, prints seconds and how many times as fast as the
first that was, and whether the outputs are equal byte by byte. On one machine the processes share
its cores, which one process uses as well: more of them gain what its threads leave idle.
"""

import argparse
import tempfile
from pathlib import Path

from tables import print_table

import bushseg
from bushseg.bundled import file_hash
from bushseg.config import PredictConfig
from bushseg.parallel import num_workers


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scan", type=Path)
    parser.add_argument("--model", default="default")
    parser.add_argument("--workers", default="1,2")
    parser.add_argument("--tile-points", type=int, default=500_000)
    options = parser.parse_args()
    counts = [int(count) for count in options.workers.split(",")]
    rows, hashes = [], set()
    with tempfile.TemporaryDirectory() as folder:
        for count in counts:
            output = Path(folder, f"{count}.las")
            config = PredictConfig(workers=count, tile_points=options.tile_points)
            result = bushseg.predict_file(options.scan, output, options.model, config)
            hashes.add(file_hash(output))
            output.unlink()
            rows.append((result.num_points, result.seconds))
    print(f"{num_workers()} cores, {options.scan.name}, outputs equal: {len(hashes) == 1}")
    print_table(
        "",
        ("workers", "points", "seconds", "times as fast"),
        [
            (str(count), points, seconds, rows[0][1] / seconds)
            for count, (points, seconds) in zip(counts, rows, strict=True)
        ],
    )


if __name__ == "__main__":
    main()
