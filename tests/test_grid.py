"""The voxel grid: keys that say where a point lies, and the same ones wherever a scan is moved."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bushseg.errors import ConfigError
from bushseg.grid import AXIS_BITS, OUTSIDE, VoxelGrid, decode_morton, encode_morton

CELLS = arrays(
    np.uint64, st.tuples(st.integers(0, 20), st.just(3)), elements=st.integers(0, 2**21 - 1)
)


def interleave(cell: list[int]) -> int:
    """A Morton code, bit by bit."""
    return sum(
        ((cell[axis] >> bit) & 1) << (3 * bit + axis)
        for bit in range(AXIS_BITS)
        for axis in range(3)
    )


@settings(deadline=None)
@given(CELLS)
def test_morton_codes_are_interleaved_bits_and_decode_again(cells: np.ndarray) -> None:
    keys = encode_morton(cells)
    assert keys.tolist() == [interleave(cell) for cell in cells.tolist()]
    assert keys.dtype == np.int64
    assert decode_morton(keys).tolist() == cells.tolist()


def test_morton_order_keeps_octants_together() -> None:
    cells = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=np.uint64)
    assert encode_morton(cells).tolist() == list(range(8))
    assert encode_morton(np.array([[2, 0, 0]], dtype=np.uint64)).tolist() == [8]


def test_points_share_a_key_exactly_where_they_share_a_voxel() -> None:
    grid = VoxelGrid(np.zeros(3), 0.5)
    points = np.array([[0.1, 0.1, 0.1], [0.4, 0.49, 0.0], [0.5, 0.1, 0.1], [0.1, 0.1, 1.2]])
    assert decode_morton(grid.keys(points)).tolist() == [[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 2]]


@pytest.mark.parametrize(
    "point",
    [
        (np.nan, 0, 0),
        (0, np.inf, 0),
        (0, 0, -np.inf),
        (-1e-9, 0, 0),
        (0, 2.0**21, 0),
        (1e300, 0, 0),
        (0, 0, -1e300),
    ],
)
def test_points_without_a_voxel_are_outside(point: tuple[float, float, float]) -> None:
    grid = VoxelGrid(np.zeros(3), 1.0)
    inside = (2.0**21 - 1, 5.0, 0.0)
    assert grid.keys(np.array([inside, point])).tolist() == [
        interleave([2**21 - 1, 5, 0]),
        OUTSIDE,
    ]


@pytest.mark.parametrize("anchor", [(np.nan, 0, 0), (0, 0, np.inf), (0, 0), 3.0])
def test_a_grid_needs_a_finite_anchor(anchor: object) -> None:
    with pytest.raises(ConfigError, match="anchor"):
        VoxelGrid.around(anchor, 0.1)  # type: ignore[arg-type]


@settings(deadline=None)
@given(
    millimetres=arrays(np.int64, (30, 3), elements=st.integers(-200_000, 200_000)),
    voxel_size=st.sampled_from([0.02, 0.05, 0.1, 0.25, 1.0]),
    shift=st.sampled_from(
        [(6_600_000.25, 0, 0), (499_999.999, 6_600_000.25, -120.5), (-1e7, 0, 3)]
    ),
)
def test_a_moved_scan_keeps_its_voxels(
    millimetres: np.ndarray, voxel_size: float, shift: tuple[float, float, float]
) -> None:
    # As files store them: integers times a scale. Points on multiples of the voxel size abound.
    here = millimetres * 0.001
    there = (millimetres + np.round(np.array(shift) / 0.001).astype(np.int64)) * 0.001
    keys = VoxelGrid.around(here[0], voxel_size).keys(here)
    assert (keys != OUTSIDE).all()
    assert (VoxelGrid.around(there[0], voxel_size).keys(there) == keys).all()


def test_no_points_have_no_keys() -> None:
    assert VoxelGrid.around((0, 0, 0), 1.0).keys(np.empty((0, 3))).shape == (0,)
