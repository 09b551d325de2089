"""Damaged files give an error or the right number of points: never a crash, never fewer."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bushseg import io
from bushseg.errors import ReadError

NAMES = [
    "ascii.ply",
    "little.ply",
    "big.ply",
    "ascii.pcd",
    "binary.pcd",
    "compressed.pcd",
    "frame.bin",
    "semantic3d.txt",
    "named.csv",
]


def read_or_refuse(name: str, content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        try:
            with io.open_scan(path) as scan:
                points = scan.read()
        except ReadError as error:
            refusal = str(error)
        else:
            assert len(points) == scan.info.num_points > 0
            assert set(points.attributes) == set(scan.info.attributes)
            return
    assert "\n" not in refusal


@pytest.mark.parametrize("name", NAMES)
def test_flipped_bytes(name: str, samples: dict[str, bytes]) -> None:
    whole = samples[name]

    @settings(max_examples=150, deadline=None)
    @given(st.lists(st.tuples(st.integers(0, len(whole) - 1), st.integers(0, 255)), max_size=4))
    def check(changes: list[tuple[int, int]]) -> None:
        content = bytearray(whole)
        for position, value in changes:
            content[position] = value
        read_or_refuse(name, bytes(content))

    check()


@pytest.mark.parametrize("name", NAMES)
def test_every_truncation(name: str, samples: dict[str, bytes]) -> None:
    for length in range(len(samples[name])):
        read_or_refuse(name, samples[name][:length])


@pytest.mark.parametrize(
    ("name", "cut"),
    [
        ("little.ply", 6),  # 5 bytes of face follow the vertices
        ("big.ply", 6),
        ("binary.pcd", 1),
        ("compressed.pcd", 1),
        ("frame.bin", 1),
    ],
)
def test_a_short_body_is_refused(
    name: str, cut: int, samples: dict[str, bytes], tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(samples[name][:-cut])
    with pytest.raises(ReadError):
        io.read(path)


@pytest.mark.parametrize("name", ["little.ply", "binary.pcd", "frame.bin", "semantic3d.txt"])
def test_a_file_that_shrinks_while_open_is_refused(
    name: str, samples: dict[str, bytes], tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_bytes(samples[name])
    with io.open_scan(path) as scan:
        path.write_bytes(samples[name][: -len(samples[name]) // 3])
        with pytest.raises(ReadError):
            scan.read()
