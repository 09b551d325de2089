"""Damage small files of each format by the hundred thousand, and see what the readers make of them.

    python benchmarks/fuzz.py --cases 100000 [FORMAT...]
    python benchmarks/fuzz.py LAZ --case 4711 --save bad.laz

Files are made on the spot (`fuzz_seeds.py`, `fuzz_stores.py`) and damaged in ways that mostly know
the format (`fuzz_mutations.py`). Allowed is a `BushsegError` of one line, or points that agree with
what the reader said of them (`fuzz_targets.py`). Cases run in batches in a forked process whose
address space may grow by 1 GB; one that dies, or stays at a case for 10 s, is replaced, and the
case is reported by its number, by which it can be made again. lazrs runs in that very process, for
speed; a case it dies of is tried again as bushseg does it, with lazrs in a process of its own, and
counted as "contained". Prints a Markdown table; exits with 1 if anything but "refused" and
"read" came of a case.
"""

import argparse
import faulthandler
import mmap
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy  # noqa: F401 - once, and not in each batch
import numpy as np
import pye57  # noqa: F401
from fuzz_mutations import mutate
from fuzz_seeds import Seed
from fuzz_stores import ALL_SEEDS, PREPARED
from fuzz_targets import WrongResultError, bring_lazrs_in, read_dataset, read_model, read_scan, run

MEMORY = 1 << 30
GROWTH = 1 << 28  # resident memory that a file of some kB may not take beyond what was taken before
SECONDS = 10
BATCH = 1000  # libE57 loses 0.2 MB over each damaged file, which would add up
KINDS = ("refused", "read", "crashed", "hung", "memory", "wrong", "contained")
_CURRENT = len(KINDS)  # the case under way, behind the counters

_LAZ = ("LAZ", "COPC")
_TARGETS = {"model": read_model, "data set": read_dataset}


@dataclass
class Report:
    """What came of a format's cases.

    Attributes:
        counts: How many of each of `KINDS`.
        seconds: How long they took.
        findings: Case number to what went wrong.
        peak: Resident memory of the largest batch, bytes.
    """

    counts: dict[str, int]
    seconds: float
    findings: dict[int, str]
    peak: int


def main() -> None:
    """Fuzz the formats asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("formats", nargs="*", metavar="FORMAT", help=", ".join(ALL_SEEDS))
    parser.add_argument("--cases", type=int, default=100_000, help="of each format")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--case", type=int, help="one case, in this process")
    parser.add_argument("--save", type=Path, help="where to put that one's file")
    options = parser.parse_args()
    formats = options.formats or list(ALL_SEEDS)
    with tempfile.TemporaryDirectory() as folder:
        if options.case is not None:
            one_case(formats[0], options.case, options.save, Path(folder))
            return
        print("| format | cases | " + " | ".join(KINDS) + " | cases/s | peak MB |")
        print("|---|" + "---:|" * (len(KINDS) + 3), flush=True)
        failed = False
        for name in formats:
            report = fuzz(name, range(options.first, options.first + options.cases), Path(folder))
            counts = " | ".join(f"{report.counts[kind]:,}" for kind in KINDS)
            rate = options.cases / report.seconds
            peak = report.peak >> 20
            print(f"| {name} | {options.cases:,} | {counts} | {rate:,.0f} | {peak:,} |", flush=True)
            for number, text in list(report.findings.items())[:40]:
                print(f"    {name} --case {number}: {text}", file=sys.stderr, flush=True)
            failed |= bool(report.findings)
    sys.exit(failed)


def fuzz(name: str, cases: range, folder: Path) -> Report:
    """Run a format's cases in forked processes, one after another."""
    seeds, home = make_seeds(name, folder)
    shared = mmap.mmap(-1, 8 * (len(KINDS) + 1))
    counts = np.frombuffer(shared, np.int64)
    findings: dict[int, str] = {}
    peak = 0
    begun = time.monotonic()
    at = cases.start
    while at < cases.stop:
        stop = min(at + BATCH, cases.stop)
        log = folder / "log"
        log.write_text("")
        process = os.fork()
        if process == 0:
            _work(name, seeds, range(at, stop), home, log, counts)
        status, used, hung = _wait(process, counts)
        peak = max(peak, 1024 * used.ru_maxrss)
        *lines, rest = log.read_text(errors="replace").split("\0\n")
        for line in lines:
            number, _, text = line.rpartition("\1")[2].partition(" ")
            findings[int(number)] = text
        if status == 0:
            at = stop
            continue
        at = int(counts[_CURRENT])
        if name in _LAZ and not hung and not _dies(name, at, seeds, home):
            counts[KINDS.index("contained")] += 1
            at += 1
            continue
        counts[KINDS.index("hung" if hung else "crashed")] += 1
        why = f"still running after {SECONDS} s" if hung else f"exit status {status}"
        findings[at] = f"{why}: {' '.join(rest.split())[-600:]}"
        at += 1
    totals = dict(zip(KINDS, counts[:_CURRENT].tolist(), strict=True))
    return Report(totals, time.monotonic() - begun, findings, peak)


def make_seeds(name: str, folder: Path) -> tuple[list[Seed], Path]:
    """A format's seeds, made in another process: threads begun here would be missing in forks.

    Returns:
        The seeds, and the folder they lie in.
    """
    import pickle

    home = folder / name.replace(" ", "_")
    home.mkdir()
    process = os.fork()
    if process == 0:
        try:
            (home / "seeds").write_bytes(pickle.dumps(list(ALL_SEEDS[name](home))))
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    if os.waitpid(process, 0)[1]:
        raise SystemExit(f"no seeds of {name}")
    return pickle.loads((home / "seeds").read_bytes()), home


def make_case(name: str, number: int, seeds: Sequence[Seed]) -> tuple[Seed, bytes]:
    """A case by its number, the same wherever it is made."""
    return mutate(np.random.default_rng([zlib.crc32(name.encode()), number]), seeds)


def try_case(name: str, number: int, seeds: Sequence[Seed], folder: Path) -> tuple[str, str]:
    """Make a case and read it in this process.

    Args:
        name: The format.
        number: The case.
        seeds: The format's.
        folder: Where the file is put; of a data set, the folder with its other files.

    Returns:
        Which of `KINDS` it is, and what went wrong, if anything did.
    """
    seed, raw = make_case(name, number, seeds)
    path = folder / seed.name
    path.write_bytes(raw)
    target: Callable[[Path], None] = _TARGETS.get(name, read_scan)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        kind, text = run(target, folder if name == "data set" else path), ""
    except MemoryError:
        kind, text = "memory", _where()
    except BaseException:
        kind, text = "wrong", _where()
    finally:
        if name == "data set":
            path.write_bytes(seed.raw)
    growth = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    if growth > GROWTH:
        kind, text = "memory", f"{growth >> 20} MB for a file of {len(raw):,} bytes"
    return kind, text


def one_case(name: str, number: int, save: Path | None, folder: Path) -> None:
    """Make one case again, and read it without limits."""
    seeds, home = make_seeds(name, folder)
    if save is not None:
        save.write_bytes(make_case(name, number, seeds)[1])
    seed, raw = make_case(name, number, seeds)
    where = home / PREPARED if name == "data set" else home
    (where / seed.name).write_bytes(raw)
    print(run(_TARGETS.get(name, read_scan), where if name == "data set" else where / seed.name))


def _work(
    name: str, seeds: Sequence[Seed], cases: range, home: Path, log: Path, counts: np.ndarray
) -> None:
    """A forked process: try cases, count, tell of findings, never return."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    handle = os.open(log, os.O_WRONLY | os.O_APPEND)
    os.dup2(handle, 2)
    faulthandler.enable()
    if name in _LAZ:
        bring_lazrs_in()
    folder = Path(tempfile.mkdtemp(dir=home))
    if name == "data set":
        folder = shutil.copytree(home / PREPARED, folder / PREPARED)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    counts[_CURRENT] = cases.start
    try_case(name, cases.start, seeds, folder)  # what libraries take to begin with is no case's
    for number in cases:
        counts[_CURRENT] = number
        kind, text = try_case(name, number, seeds, folder)
        counts[KINDS.index(kind)] += 1
        if text:
            os.write(handle, f"\1{number} {kind}: {text}\0\n".encode(errors="replace"))
    shutil.rmtree(folder)
    os._exit(0)


def _dies(name: str, number: int, seeds: Sequence[Seed], home: Path) -> bool:
    """Whether a case is anything but refused or read with lazrs in a process of its own."""
    process = os.fork()
    if process == 0:
        kind, _ = try_case(name, number, seeds, Path(tempfile.mkdtemp(dir=home)))
        os._exit(kind not in ("refused", "read"))
    return os.waitpid(process, 0)[1] != 0


def _wait(process: int, counts: np.ndarray) -> tuple[int, resource.struct_rusage, bool]:
    """Wait for a process, or end it when it stays at one case: exit status, usage, whether hung."""
    case, since = -1, time.monotonic()
    pause = 0.01
    while True:
        done, status, used = os.wait4(process, os.WNOHANG)
        if done:
            return status, used, False
        if counts[_CURRENT] != case:
            case, since = int(counts[_CURRENT]), time.monotonic()
        elif time.monotonic() - since > SECONDS:
            os.kill(process, signal.SIGKILL)
            _, status, used = os.wait4(process, 0)
            return status, used, True
        time.sleep(pause)
        pause = min(0.5, 2 * pause)


def _where() -> str:
    """The exception under way, and the lines of bushseg it came through."""
    kind, error, trace = sys.exc_info()
    frames = [
        f"{Path(frame.filename).name}:{frame.lineno}" for frame in traceback.extract_tb(trace)
    ]
    name = "wrong result" if kind is WrongResultError else getattr(kind, "__name__", "?")
    cause = f" from {error.__cause__}"[:200] if error and error.__cause__ else ""
    return f"{name}: {' '.join(str(error).split())[:200]}{cause} ({' '.join(frames[-5:])})"


if __name__ == "__main__":
    main()
