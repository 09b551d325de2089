import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.simulation.sensors.beam import (
    across,
    counts,
    group,
    near_edges,
    ranks,
    ring,
    select,
)
from bushseg.simulation.sensors.figures import Figures

INF = np.inf


def echoes_of(ranges, resolution=0.5, reflectance=0.5, cosine=1.0):
    ranges = np.array(ranges, float)
    full = np.ones_like(ranges)
    return group(ranges, reflectance * full, cosine * full, resolution)


def test_what_lies_within_the_resolution_is_averaged():
    echoes = echoes_of([[4.0, 4.2, 4.4, 4.0]])
    assert echoes.beam.tolist() == [0]
    assert echoes.range[0] == pytest.approx(4.15)
    assert echoes.light[0] == pytest.approx(0.5)


def test_what_lies_farther_apart_is_told_apart():
    echoes = echoes_of([[7.0, 4.0, INF, 7.2], [INF] * 4, [9.0, INF, INF, INF]])
    assert echoes.beam.tolist() == [0, 0, 2]
    np.testing.assert_allclose(echoes.range, [4.0, 7.1, 9.0])
    np.testing.assert_allclose(echoes.light, [0.125, 0.25, 0.125])
    assert echoes.strongest.tolist() == [1, 0, 8]
    assert ranks(echoes.beam).tolist() == [0, 1, 0]
    assert counts(echoes.beam).tolist() == [2, 2, 1]


def test_the_brighter_part_draws_the_range_and_names_the_echo():
    ranges, reflectance = np.array([[4.0, 4.4]]), np.array([[0.1, 0.3]])
    echoes = group(ranges, reflectance, np.ones((1, 2)), 0.5)
    assert echoes.range[0] == pytest.approx(4.3)
    assert echoes.strongest.tolist() == [1]


def test_nothing_struck_is_no_echo():
    assert len(echoes_of([[INF, INF]])) == 0
    assert len(select(echoes_of([[INF]]), Figures())) == 0


def test_select():
    echoes = echoes_of([[2.0, 4.0, 6.0, 6.0], [3.0, INF, INF, INF], [1.0, 50.0, 50.0, 50.0]])
    assert select(echoes, Figures(echo="all", max_returns=2)).range.tolist() == [2, 4, 3, 1, 50]
    assert select(echoes, Figures(echo="last")).range.tolist() == [6, 3, 50]
    # Light weakens with the square of the range: half of it at 6 m is less than a quarter at 2 m.
    assert select(echoes, Figures(echo="strongest")).range.tolist() == [2, 3, 1]


@given(st.lists(st.lists(st.sampled_from([1.0, 1.3, 2.5, 8.0, INF]), min_size=3, max_size=3)))
def test_no_light_is_lost_or_made(rows):
    ranges = np.array(rows, float).reshape(-1, 3)
    echoes = echoes_of(ranges)
    assert echoes.light.sum() == pytest.approx(np.isfinite(ranges).sum() * 0.5 / 3)
    assert (np.diff(echoes.beam) >= 0).all()
    assert set(echoes.beam) == set(np.flatnonzero(np.isfinite(ranges).any(axis=1)))
    for beam in set(echoes.beam):
        assert (np.diff(echoes.range[echoes.beam == beam]) > 0.5).all()


def test_the_footprint_grows_as_the_divergence_says():
    figures = Figures(sub_rays=7, exit_diameter=0.01, divergence=2.0)
    directions = np.array([(0.6, 0.8, 0.0), (0.0, 0.0, -1.0)])
    origins, around = ring(np.random.default_rng(0), np.zeros((2, 3)), directions, figures)
    assert around.shape == (2, 6, 3)
    # The ring stands for the outer six sevenths of a Gaussian beam: half of them lie within it.
    share = np.sqrt(-np.log(3 / 7) / 2)
    for distance in (0.0, 100.0):
        spot = origins + distance * around
        radii = np.linalg.norm(spot - distance * directions[:, None], axis=2)
        np.testing.assert_allclose(radii, share * (0.01 + 0.002 * distance) / 2)
        np.testing.assert_allclose(spot.mean(axis=1), distance * directions, atol=1e-12)
        np.testing.assert_allclose(np.einsum("ijk,ik->ij", spot, directions), distance, atol=1e-12)


def test_edges_are_where_ranges_bend():
    level = 1.5 / np.sin(np.radians(np.arange(10.0, 30.0, 0.3)))  # ground below a tripod
    assert not near_edges(level)[1:-1].any()
    assert near_edges(np.array([5.0, 5, 5, 6, 6, 6])).tolist()[1:-1] == [False, True, True, False]
    assert near_edges(np.array([INF, INF, INF, 6, 6, 6, INF])).tolist() == [
        *(False, False, True, True, False, True, True)
    ]


def test_across_is_square_to_the_beam():
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    frames = np.stack([directions, *across(directions)], axis=1)
    eyes = np.broadcast_to(np.eye(3), frames.shape)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), eyes, atol=1e-12)
