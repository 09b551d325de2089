"""Sizes that fit a given memory."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.errors import ConfigError
from bushseg.memory import (
    LEAST,
    be_lean,
    fit,
    fit_table,
    give_back,
    parse_size,
    peak_memory,
    share,
)

# What a process says of its peak: at first, and after it has had 64 MB more.
PEAKS = """
from bushseg.memory import peak_memory
first = peak_memory()
more = b"x" * 64_000_000
print(first, peak_memory())
"""
# Its parent's, which has had 256 MB.
LARGE_PARENT = """
import subprocess, sys
from bushseg.memory import peak_memory
more = b"x" * 256_000_000
print(peak_memory(), flush=True)
subprocess.run([sys.executable, "-c", sys.argv[1]], check=True)
"""


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("2GB", 2_000_000_000),
        ("1.5 GiB", 1_610_612_736),
        ("800M", 800_000_000),
        ("123", 123),
        (" 4 kb ", 4_000),
        ("1t", 10**12),
    ],
)
def test_sizes_as_people_write_them(text: str, size: int) -> None:
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "GB", "-1GB", "2XB", "1,5GB", "nan", "٢GB"])
def test_what_is_no_size(text: str) -> None:
    with pytest.raises(ConfigError, match="is no size; expected a number and a unit"):
        parse_size(text)


@given(st.integers(0, 10**13), st.integers(1, 64))
def test_what_is_chosen_fits(beyond: int, workers: int) -> None:
    max_memory = replace(LEAST, workers=workers).num_bytes + beyond
    sizes = fit(max_memory, workers)
    assert sizes.num_bytes <= max_memory
    assert sizes.tile_points >= LEAST.tile_points
    assert sizes.max_voxels >= LEAST.max_voxels
    assert sizes.tile_points <= fit(max_memory).tile_points


def test_too_little_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"max_memory is 0\.50 GB; labelling takes at least 0\.96"
    ):
        fit(500_000_000)
    with pytest.raises(ConfigError, match=r"labelling in 4 processes takes at least 4\.52 GB"):
        fit(2_000_000_000, 4)


@given(st.integers(1_000, 4_000_000), st.integers(1, 200), st.integers(0, 10**13))
def test_a_table_for_prepare(tile_points: int, num_classes: int, max_memory: int) -> None:
    try:
        max_voxels = fit_table(max_memory, tile_points, num_classes)
    except ConfigError:
        assert max_memory < 2 * 10**9
        return
    assert LEAST.max_voxels <= max_voxels <= fit_table(max_memory + 10**9, tile_points, 1)
    assert max_voxels * (200 + 8 * num_classes) < max_memory


def test_too_little_for_prepare_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"0\.30 GB; preparing tiles of 4,000,000 .* 1\.49 GB"):
        fit_table("300 MB", 4_000_000, 8)
    assert fit_table("2GB", 120_000, 8) == fit_table(2 * 10**9, 120_000, 8)


def test_processes_of_prepare_share() -> None:
    for workers in (2, 3):
        each = fit_table(5 * 10**9, 120_000, 8, workers)
        assert each == fit_table(share(5 * 10**9, workers), 120_000, 8)
    with pytest.raises(ConfigError, match=r"voxels in 9 processes takes at least .* or fewer"):
        fit_table("5GB", 120_000, 8, 9)


def test_giving_memory_back_is_harmless() -> None:
    be_lean()
    give_back()


@pytest.mark.skipif(peak_memory() is None, reason="this system doesn't tell")
def test_a_peak_is_a_process_own_however_large_the_one_that_started_it() -> None:
    command = [sys.executable, "-c", LARGE_PARENT, PEAKS]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    parent, first, peak = map(int, said.split())
    assert parent > 256_000_000
    assert 1_000_000 < first < 128_000_000
    assert 60_000_000 < peak - first < 80_000_000


@pytest.mark.skipif(sys.platform != "linux", reason="other systems tell of a process itself alone")
def test_the_peak_of_another_process() -> None:
    own = peak_memory(os.getpid())
    assert own is not None
    assert peak_memory() == pytest.approx(own, rel=0.05)
    assert peak_memory(2**22 + 1) is None  # beyond the highest number there is
