"""Triangle meshes, and the few solids everything on a site is put together from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bushseg.points import FloatArray
from bushseg.simulation.materials import Material


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles in space, seen from both sides.

    Attributes:
        vertices: Corners in metres from the site's origin, shape (V, 3), float32.
        triangles: Rows of `vertices`, shape (T, 3), uint32.
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.uint32]

    @classmethod
    def of(cls, vertices: ArrayLike, triangles: ArrayLike) -> Mesh:
        """Make a mesh of anything array-like."""
        return cls(np.asarray(vertices, np.float32), np.asarray(triangles, np.uint32))


class Surface(NamedTuple):
    """A mesh and what it is made of."""

    mesh: Mesh
    material: Material


Model = list[Surface]
"""One thing, such as a bush: its surfaces around its own origin, standing on z = 0."""


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Make one mesh of several."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh.of(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([m.triangles + np.uint32(s) for m, s in zip(meshes, starts, strict=False)]),
    )


def instances(
    mesh: Mesh, positions: FloatArray, rotations: FloatArray | None = None, scales: ArrayLike = 1.0
) -> Mesh:
    """Repeat a mesh.

    Args:
        mesh: The prototype with V vertices and T triangles.
        positions: Where each copy's origin goes, metres, shape (N, 3).
        rotations: A rotation matrix a copy, shape (N, 3, 3); None leaves all upright.
        scales: A factor a copy, shape (N,), one an axis as well, shape (N, 3), or one for all.

    Returns:
        One mesh with N * V vertices and N * T triangles.
    """
    num_copies = len(positions)
    factors = np.asarray(scales, np.float32)
    if factors.ndim == 1:
        factors = factors[:, None]
    factors = np.broadcast_to(factors, (num_copies, 3))
    vertices = mesh.vertices * factors[:, None]  # (N, V, 3)
    if rotations is not None:
        vertices = vertices @ rotations.astype(np.float32).transpose(0, 2, 1)
    vertices = vertices + positions.astype(np.float32)[:, None]
    starts = np.arange(num_copies, dtype=np.uint32) * np.uint32(len(mesh.vertices))
    triangles = mesh.triangles[None] + starts[:, None, None]
    return Mesh.of(vertices.reshape(-1, 3), triangles.reshape(-1, 3))


def placed(model: Model, position: ArrayLike, yaw: float = 0.0) -> Model:
    """Turn a model by `yaw` radians about z and move its origin to `position` (3,), metres."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]])
    where = np.asarray(position, np.float64)[None]
    return [Surface(instances(mesh, where, rotation), material) for mesh, material in model]


def box(low: ArrayLike, high: ArrayLike) -> Mesh:
    """An upright box between two corners, (3,) each, metres."""
    corners = np.stack([np.asarray(low), np.asarray(high)])
    x, y, z = np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")
    vertices = np.stack([corners[x.ravel(), 0], corners[y.ravel(), 1], corners[z.ravel(), 2]], 1)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return polyhedron(vertices, quads)


def polyhedron(vertices: ArrayLike, faces: Sequence[Sequence[int]]) -> Mesh:
    """A solid with flat convex faces, each a ring of rows of `vertices` (V, 3)."""
    triangles = [(face[0], second, third) for face in faces for second, third in pairwise(face[1:])]
    return Mesh.of(vertices, triangles)


def tube(path: ArrayLike, radii: ArrayLike, sides: int = 6) -> Mesh:
    """A round rod, closed at both ends, along a line `path` (K, 3) with `radii` (K,), metres."""
    return tubes(np.asarray(path, np.float64)[None], np.asarray(radii, np.float64)[None], sides)


def tubes(paths: FloatArray, radii: FloatArray, sides: int = 6) -> Mesh:
    """Round rods, closed at both ends, all of the same make.

    Args:
        paths: Points of each rod's axis, metres, shape (N, K, 3), K at least 2.
        radii: The radius at each of them, metres, shape (N, K).
        sides: Corners of the cross-section.

    Returns:
        One mesh of N rods.
    """
    num_rods, num_rings, _ = paths.shape
    directions = np.gradient(paths, axis=1)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    # Any direction that is nowhere parallel to a rod's axis spans its cross-sections.
    reference = np.eye(3)[np.abs(directions).max(axis=1).argmin(axis=1)]
    u = np.cross(directions, reference[:, None])
    u /= np.linalg.norm(u, axis=2, keepdims=True)
    v = np.cross(directions, u)
    angles = np.arange(sides) * (2 * np.pi / sides)
    rings = np.cos(angles)[:, None] * u[:, :, None] + np.sin(angles)[:, None] * v[:, :, None]
    vertices = paths[:, :, None] + radii[:, :, None, None] * rings  # (N, K, sides, 3)

    ring, side = np.meshgrid(np.arange(num_rings - 1), np.arange(sides), indexing="ij")
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    mantle = np.stack([a, b, b + sides, a, b + sides, a + sides], axis=-1).reshape(-1, 3)
    fan = np.stack([np.zeros(sides - 2, int), np.arange(1, sides - 1), np.arange(2, sides)], axis=1)
    rod = np.concatenate([mantle, fan, fan + (num_rings - 1) * sides])
    starts = np.arange(num_rods) * (num_rings * sides)
    return Mesh.of(vertices.reshape(-1, 3), (rod + starts[:, None, None]).reshape(-1, 3))


def ellipsoid(center: ArrayLike, radii: ArrayLike, sides: int = 10) -> Mesh:
    """An ellipsoid with upright axes: `center` (3,) and `radii` (3,), metres."""
    polar = np.linspace(0, np.pi, sides)
    profile = tube(
        np.stack([np.zeros(sides), np.zeros(sides), -np.cos(polar)], axis=1), np.sin(polar), sides
    )
    return Mesh.of(np.asarray(center) + profile.vertices * np.asarray(radii), profile.triangles)
