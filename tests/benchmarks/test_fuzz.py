"""Some hundred cases a format: the first of those `benchmarks/fuzz.py` runs by the thousand."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "fuzz.py"
LIMITS = pytest.mark.skipif(sys.platform != "linux", reason="limits and forks as Linux has them")


@pytest.fixture(scope="session")
def fuzz(benchmark_module):
    pytest.importorskip("pye57")
    return benchmark_module("fuzz")


@LIMITS
@pytest.mark.parametrize(
    ("formats", "cases"),
    [
        (["LAS", "PLY", "PCD", "KITTI", "text"], 300),
        (["LAZ", "COPC", "E57", "model", "data set"], 60),
    ],
)
def test_damage_is_refused_or_harmless(formats: list[str], cases: int) -> None:
    # A process of its own: one that has begun threads must not fork.
    pytest.importorskip("pye57")
    command = [sys.executable, str(BENCHMARK), *formats, "--cases", str(cases)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    _, _, *rows = run.stdout.splitlines()
    assert len(rows) == len(formats)
    for name, row in zip(formats, rows, strict=True):
        found, _, refused, read, *others, contained, _, _ = row.strip("| ").split(" | ")
        assert found == name
        assert int(refused) + int(read) + int(contained) == cases
        assert int(refused) > 10
        assert int(read) > 0
        assert set(others) == {"0"}


@LIMITS
def test_a_case_is_its_number(fuzz, tmp_path: Path) -> None:
    seeds, _ = fuzz.make_seeds("text", tmp_path)
    cases = [fuzz.make_case("text", number, seeds)[1] for number in range(20)]
    assert cases == [fuzz.make_case("text", number, seeds)[1] for number in range(20)]
    assert len(set(cases)) > 15


@LIMITS
@pytest.mark.parametrize("kind", ["crashed", "hung", "memory", "wrong"])
def test_findings_are_found(fuzz, kind: str, tmp_path: Path, monkeypatch) -> None:
    hold: list[bytearray] = []

    def target(path: Path) -> None:
        if kind == "crashed":
            os.abort()
        elif kind == "hung":
            while True:
                pass
        elif kind == "memory":
            hold.append(bytearray(2 << 30))
        raise KeyError("text")

    monkeypatch.setattr(fuzz, "SECONDS", 0.2)
    monkeypatch.setitem(fuzz._TARGETS, "KITTI", target)
    report = fuzz.fuzz("KITTI", range(2), tmp_path)
    assert report.counts[kind] == 2
    assert set(report.findings) == {0, 1}
