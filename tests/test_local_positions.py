"""Positions in a tile: on the scan's lattice, near the tile, exact in float32."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.local_positions import STEPS, local_positions


@pytest.mark.parametrize("voxel_size", [1e-6, 0.03, 7.0, 1e9])
def test_positions_are_rounded_to_less_than_a_thousandth_of_a_voxel(voxel_size: float) -> None:
    xyz = np.random.default_rng(2).random((500, 3)) * 20 * voxel_size
    indices = np.arange(0, 500, 3)
    local, origin = local_positions(xyz, indices, voxel_size)
    assert local.dtype == np.float32
    half_a_step = voxel_size / STEPS / 2
    np.testing.assert_allclose(local + origin, xyz[indices], atol=half_a_step, rtol=0)
    np.testing.assert_allclose(local.mean(axis=0), 0, atol=2 * half_a_step)


@given(seed=st.integers(0, 2**32 - 1), shift=st.floats(-1e5, 1e5))
def test_two_points_lie_to_each_other_as_they_do_in_any_other_tile(seed: int, shift: float) -> None:
    xyz = np.random.default_rng(seed).random((60, 3)) * 40 + shift
    here, _ = local_positions(xyz, np.arange(40), 0.1)
    there, _ = local_positions(xyz, np.arange(20, 60), 0.1)
    np.testing.assert_array_equal(here[21:40] - here[20], there[1:20] - there[0])
