import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bushseg.simulation.materials import STONE
from bushseg.simulation.mesh import (
    Surface,
    box,
    ellipsoid,
    instances,
    join,
    placed,
    polyhedron,
    tube,
    tubes,
)


def area(mesh):
    a, b, c = mesh.vertices[mesh.triangles].astype(float).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def edges_per_triangle_pair(mesh):
    """How many triangles share each edge."""
    edges = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def test_box_is_closed_and_has_its_area():
    mesh = box((1, 2, 3), (2, 4, 6))
    assert area(mesh) == pytest.approx(2 * (1 * 2 + 2 * 3 + 1 * 3))
    assert np.all(edges_per_triangle_pair(mesh) == 2)
    np.testing.assert_array_equal(mesh.vertices.min(axis=0), (1, 2, 3))
    np.testing.assert_array_equal(mesh.vertices.max(axis=0), (2, 4, 6))


def test_polyhedron_cuts_faces_into_fans():
    mesh = polyhedron([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2, 3)])
    np.testing.assert_array_equal(mesh.triangles, [(0, 1, 2), (0, 2, 3)])


def test_join_shifts_indices():
    triangle = polyhedron([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    mesh = join([triangle, triangle])
    np.testing.assert_array_equal(mesh.triangles, [(0, 1, 2), (3, 4, 5)])
    assert mesh.vertices.shape == (6, 3)
    assert mesh.vertices.dtype == np.float32
    assert mesh.triangles.dtype == np.uint32


def test_instances_scale_then_turn_then_move():
    stick = polyhedron([(0, 0, 0), (1, 0, 0), (0, 0, 1)], [(0, 1, 2)])
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], float)
    mesh = instances(
        stick,
        np.array([(0, 0, 0), (10, 0, 0)], float),
        np.stack([np.eye(3), quarter]),
        [1.0, 2.0],
    )
    np.testing.assert_allclose(mesh.vertices[1], (1, 0, 0))
    np.testing.assert_allclose(mesh.vertices[4], (10, 2, 0), atol=1e-6)
    np.testing.assert_allclose(mesh.vertices[5], (10, 0, 2), atol=1e-6)
    np.testing.assert_array_equal(mesh.triangles, [(0, 1, 2), (3, 4, 5)])


def test_placed_turns_about_z_and_keeps_the_material():
    ((mesh, material),) = placed([Surface(box((0, 0, 0), (2, 1, 1)), STONE)], (5, 5, 1), np.pi / 2)
    np.testing.assert_allclose(mesh.vertices.min(axis=0), (4, 5, 1), atol=1e-6)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), (5, 7, 2), atol=1e-6)
    assert material is STONE


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1)


@given(direction=directions, radius=st.floats(0.01, 2))
def test_tube_keeps_its_radius_in_any_direction(direction, radius):
    axis = np.asarray(direction) / np.linalg.norm(direction)
    mesh = tube([(0, 0, 0), 2 * axis, 5 * axis], [radius] * 3, sides=8)
    vertices = mesh.vertices.astype(float)
    off_axis = vertices - (vertices @ axis)[:, None] * axis
    np.testing.assert_allclose(np.linalg.norm(off_axis, axis=1), radius, rtol=1e-3)
    assert np.all(edges_per_triangle_pair(mesh) == 2)


def test_many_tubes_are_the_single_ones():
    rng = np.random.default_rng(0)
    paths, radii = rng.normal(size=(4, 3, 3)), rng.uniform(0.1, 1, (4, 3))
    single = join([tube(path, radius) for path, radius in zip(paths, radii, strict=True)])
    together = tubes(paths, radii)
    np.testing.assert_array_equal(together.vertices, single.vertices)
    np.testing.assert_array_equal(together.triangles, single.triangles)


def test_ellipsoid_lies_on_its_surface():
    mesh = ellipsoid((1, 2, 3), (0.5, 1.0, 2.0))
    unit = (mesh.vertices - (1, 2, 3)) / (0.5, 1.0, 2.0)
    np.testing.assert_allclose(np.linalg.norm(unit, axis=1), 1, atol=1e-5)
