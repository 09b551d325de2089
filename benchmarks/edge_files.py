"""Read odd and broken files, and see that none crashes, hangs or lies.

    python benchmarks/edge_files.py FOLDER...

Each file is read twice, by bushseg's readers and by those `bushseg verify` has, which share nothing
with them, each time in a process of its own with 2 GB of address space (RLIMIT_AS) and 20 seconds.
Where both read it, the number of points, the coordinates and all attributes of the same name must
agree. Prints a Markdown table; exits with 1 if a file crashed bushseg, hung it, or was read as
something else.
"""

import argparse
import re
import resource
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bushseg import io
from bushseg.errors import ReadError
from bushseg.verification.libraries import read_columns
from bushseg.verification.rows import Columns

MEMORY = 2 << 30
SECONDS = 20
_REFUSED = 3  # exit status of a child whose reader said no
_TELLING = re.compile(r"^\S*(Error|Exception|memory)\b")  # what a stack trace says in the end


@dataclass(frozen=True)
class Outcome:
    """What became of one attempt to read a file.

    Attributes:
        kind: "read", "refused", "crashed" or "hung".
        message: Why, unless it was read.
        columns: What was read, or None.
    """

    kind: str
    message: str = ""
    columns: Columns | None = None


def main() -> None:
    """Read every file of the folders and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path)
    folders = parser.parse_args().folders
    totals: Counter[str] = Counter()
    print("| file | outcome | independent reader |\n|---|---|---|")
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if io.suffix_of(path) not in io.SUFFIXES or path.is_dir():
                continue
            ours, theirs = attempt("bushseg", path), attempt("independent", path)
            verdict = compare(ours, theirs)
            totals[ours.kind] += 1
            totals["lied"] += verdict.startswith("LIE")
            what = "read" if ours.columns is None else f"read: {len(ours.columns['xyz']):,} points"
            outcome = what if ours.kind == "read" else f"{ours.kind}: {ours.message}"
            print(f"| {path.relative_to(folder)} | {outcome} | {verdict} |", flush=True)
    kinds = ("read", "refused", "crashed", "hung", "lied")
    print(f"\n{sum(totals.values()) - totals['lied']} files:", end=" ")
    print(", ".join(f"{totals[kind]} {kind}" for kind in kinds))
    if totals["crashed"] or totals["hung"] or totals["lied"]:
        sys.exit(1)


def attempt(reader: str, path: Path) -> Outcome:
    """Read a file in a limited process; `reader` is "bushseg" or "independent"."""
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder, "columns.npz")
        command = [sys.executable, __file__, "--child", reader, str(path), str(result)]
        try:
            run = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
        except subprocess.TimeoutExpired:
            return Outcome("hung", f"still running after {SECONDS} s")
        if run.returncode == 0:
            with np.load(result, allow_pickle=False) as columns:
                return Outcome("read", columns=dict(columns))
        lines = run.stderr.splitlines() or [f"exit status {run.returncode}"]
        if run.returncode == _REFUSED:
            return Outcome("refused", lines[-1])
        return Outcome("crashed", next(filter(_TELLING.search, lines), lines[-1]))


def compare(ours: Outcome, theirs: Outcome) -> str:
    """What the independent reader says to our outcome."""
    if theirs.columns is None:
        return f"can't read it: {theirs.message}"
    if ours.columns is None:
        return f"reads {len(theirs.columns['xyz']):,} points"
    shared = [name for name in theirs.columns if name in ours.columns]
    for name in shared:
        mine, other = ours.columns[name], theirs.columns[name]
        if len(mine) != len(other):
            return f"LIE: {len(mine):,} points, expected {len(other):,}"
        other = other.reshape(len(other), -1)
        mine = mine.reshape(len(mine), -1)[:, : other.shape[1]]
        equal_nan = mine.dtype.kind == "f" and other.dtype.kind == "f"
        if not np.array_equal(mine, other, equal_nan=equal_nan):
            return f"LIE: {name} differs in {np.count_nonzero(mine != other):,} values"
    return (
        f"agrees in {', '.join(shared)}" if len(shared) < 4 else f"agrees in {len(shared)} columns"
    )


def read_in_child(reader: str, path: Path, result: Path) -> None:
    """What a child process does: read within the limit, leave the columns, or say why not."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    if reader == "independent":
        columns = read_columns(path)
    else:
        try:
            cloud = io.read(path)
        except ReadError as error:
            print(f"{error.found}; expected {error.expected}", file=sys.stderr)
            sys.exit(_REFUSED)
        columns = {"xyz": cloud.xyz, **cloud.attributes}
    np.savez(result, allow_pickle=False, **columns)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        read_in_child(sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4]))
    else:
        main()
