"""What it costs to decompress LAZ in a process of its own.

    python benchmarks/isolation.py FILE...

Reads each file's points with lazrs in this process, and as bushseg does, turn about, and prints the
least of several times as a Markdown table: seconds passed, and seconds of all processors used.
"""

import argparse
import resource
import time
from pathlib import Path

import laspy  # noqa: F401 - before the clock runs
from fuzz_targets import bring_lazrs_in

from bushseg import io
from bushseg.io.laz_process import LazProcess

REPEATS = 5


def main() -> None:
    """Time both ways."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("files", nargs="+", type=Path)
    print("| file | points | s inside | s apart | CPU s inside | CPU s apart |")
    print("|---|---:|---:|---:|---:|---:|")
    apart = LazProcess.run
    for path in parser.parse_args().files:
        times: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
        num_points = 0
        for _ in range(REPEATS):
            for inside in (True, False):
                if inside:
                    bring_lazrs_in()
                else:
                    LazProcess.run = apart  # type: ignore[method-assign]
                begun, used = time.perf_counter(), cpu()
                with io.open_scan(path) as scan:
                    num_points = sum(map(len, scan.chunks()))
                times[inside].append((time.perf_counter() - begun, cpu() - used))
        least = [
            f"{min(entry[what] for entry in times[inside]):.3f}"
            for what in (0, 1)
            for inside in (True, False)
        ]
        print(f"| `{path.name}` | {num_points:,} | " + " | ".join(least) + " |", flush=True)


def cpu() -> float:
    """Processor seconds of this process and of those it has waited for."""
    usages = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


if __name__ == "__main__":
    main()
