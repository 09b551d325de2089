"""How long does a scan, or a folder of scans, take with several worker processes?

    python benchmarks/workers.py SCAN... [--model NAME] [--workers 1,2,4] [--tile-points 500000]

Labels the scans with each number of processes, prints seconds and how many times as fast as the
first that was, and whether the outputs are equal byte by byte. Of one scan the processes label
tiles, of several whole scans. On one machine they share its cores, which one process uses as well:
more of them gain what its threads leave idle. The seconds hold the processes' start.
"""

import argparse
import tempfile
import time
from pathlib import Path

from tables import print_table

import bushseg
from bushseg.bundled import file_hash
from bushseg.config import PredictConfig
from bushseg.parallel import num_workers


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", type=Path, nargs="+", metavar="SCAN")
    parser.add_argument("--model", default="default")
    parser.add_argument("--workers", default="1,2")
    parser.add_argument("--tile-points", type=int, default=500_000)
    options = parser.parse_args()
    counts = [int(count) for count in options.workers.split(",")]
    rows, hashes = [], set()
    for count in counts:
        config = PredictConfig(workers=count, tile_points=options.tile_points)
        with tempfile.TemporaryDirectory() as folder:
            begun = time.perf_counter()
            outputs, points = _label(options.scans, Path(folder), options.model, config)
            rows.append((points, time.perf_counter() - begun))
            hashes.add(tuple(map(file_hash, outputs)))
    names = ", ".join(scan.name for scan in options.scans)
    print(f"{num_workers()} cores, {names}, outputs equal: {len(hashes) == 1}")
    print_table(
        "",
        ("workers", "points", "seconds", "times as fast"),
        [
            (str(count), points, seconds, rows[0][1] / seconds)
            for count, (points, seconds) in zip(counts, rows, strict=True)
        ],
    )


def _label(
    scans: list[Path], folder: Path, model: str, config: PredictConfig
) -> tuple[list[Path], int]:
    """Label scans; gives the outputs, and how many points they have."""
    if len(scans) == 1:
        result = bushseg.predict_file(scans[0], folder / "out.las", model, config)
        return [result.output], result.num_points
    found = bushseg.predict_folder(scans, folder, model, config)
    if not found.complete:
        raise SystemExit(next(scan.error for scan in found.scans if scan.error))
    return [scan.output for scan in found.scans], found.num_points


if __name__ == "__main__":
    main()
