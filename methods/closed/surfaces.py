"""A closed mesh with all that one round of the fusion asks of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from harness.core.arrays import AnyInts, Floats, Ints
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from harness.geometry.topology import edges_of

#: How often the directions in which vertices move are averaged over their neighbours, so that
#: vertices of a fold do not run into each other.
_DIRECTION_ROUNDS = 6
#: A direction that turned away from its vertex' normal by more than 73 degrees is given up.
_LEAST_COSINE = 0.3
#: Tangential smoothing leaves out vertices whose normal is not that of the neighbourhood.
_FLAT_COSINE = 0.7


def lengths(vectors: Floats) -> Floats:
    """(N,) lengths of (N, 3) vectors."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def unit(vectors: Floats) -> Floats:
    """(N, 3) vectors at unit length; nothing stays nothing."""
    length = lengths(vectors)
    return vectors / np.where(length > 0, length, 1.0)[:, None]


def vertex_sums(faces: AnyInts, values: Floats, count: int) -> Floats:
    """(V,) or (V, C): at each of ``count`` vertices the sum of its faces' values (F,) or (F, C)."""
    if values.ndim == 2:
        columns = [vertex_sums(faces, column, count) for column in values.T]
        return np.stack(columns, axis=1)
    return np.bincount(faces.ravel(), np.repeat(values, 3), count).astype(np.float64)


class Surface:
    """A closed mesh (world metres), its normals, areas and neighbours, and rays against it.

    Attributes:
        mesh: The mesh.
        areas_m2: (F,) of the faces.
        face_normals: (F, 3) unit, 0 for a face without area.
        vertex_normals: (V, 3) unit, weighted by area.
        vertex_areas_m2: (V,) a third of the areas around.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        vectors = mesh.face_normals()
        doubled = lengths(vectors)
        count = len(mesh.vertices)
        self.areas_m2 = doubled / 2
        self.face_normals = vectors / np.where(doubled > 0, doubled, 1.0)[:, None]
        self.vertex_normals = unit(vertex_sums(mesh.faces, vectors, count))
        self.vertex_areas_m2 = vertex_sums(mesh.faces, self.areas_m2 / 3, count)

    @cached_property
    def caster(self) -> Raycaster:
        """Rays against the mesh."""
        return Raycaster(self.mesh)

    @cached_property
    def centroids(self) -> Floats:
        """(F, 3) middles of the faces."""
        return self.mesh.vertices[self.mesh.faces].mean(axis=1)

    @cached_property
    def neighbours(self) -> Neighbours:
        """Which vertices are joined."""
        return Neighbours.of(self.mesh)

    @cached_property
    def directions(self) -> Floats:
        """(V, 3) unit directions in which vertices move: smoothed normals."""
        directions = self.vertex_normals
        for _ in range(_DIRECTION_ROUNDS):
            directions = unit(0.5 * directions + 0.5 * self.neighbours.means(directions))
        turned = np.einsum("ij,ij->i", directions, self.vertex_normals) < _LEAST_COSINE
        directions[turned] = self.vertex_normals[turned]
        return directions

    @cached_property
    def smooth_face_normals(self) -> Floats:
        """(F, 3) unit normals of the faces' wider surroundings."""
        around = self.neighbours.means(self.vertex_normals)
        return unit(around[self.mesh.faces].sum(axis=1))

    def at_vertices(self, values: Floats) -> Floats:
        """(V,) means of the faces' values (F,) around each vertex, weighted by area."""
        sums = vertex_sums(self.mesh.faces, values * self.areas_m2 / 3, len(self.mesh.vertices))
        return sums / np.maximum(self.vertex_areas_m2, 1e-12)

    def moved(self, vertices: Floats) -> Surface:
        """The same faces on other vertices (V, 3)."""
        moved = Surface(Mesh(vertices, self.mesh.faces, source=self.mesh.source))
        # Which vertices are joined does not change when they move.
        moved.__dict__["neighbours"] = self.neighbours
        return moved


@dataclass(frozen=True, slots=True, eq=False)
class Neighbours:
    """Which vertices of a mesh are joined by an edge.

    Attributes:
        edges: (E, 2) each edge once, the smaller index first.
        averaging: (V, V) sparse; times values of vertices gives means over their neighbours.
    """

    edges: Ints
    averaging: Any

    @classmethod
    def of(cls, mesh: Mesh) -> Neighbours:
        """The neighbours in a closed mesh."""
        from scipy.sparse import csr_array

        count = len(mesh.vertices)
        edges = edges_of(mesh.faces).ends
        low, high = edges.T
        rows, columns = np.concatenate([low, high]), np.concatenate([high, low])
        degree = np.bincount(rows, minlength=count)
        averaging = csr_array((1.0 / degree[rows], (rows, columns)), shape=(count, count))
        return cls(edges, averaging)

    def means(self, values: Floats) -> Floats:
        """(V, ...) means of the values (V, ...) of each vertex' neighbours."""
        return self.averaging @ values


def smoothed_along(surface: Surface, rounds: int, share: float) -> Surface:
    """The surface with its vertices spread evenly along itself; its shape stays.

    Args:
        surface: A closed surface.
        rounds: How often.
        share: Share of the way to the middle of the neighbours.
    """
    for _ in range(rounds):
        normals = surface.vertex_normals
        vertices = surface.mesh.vertices
        way = surface.neighbours.means(vertices) - vertices
        around = unit(normals + surface.neighbours.means(normals))
        # Slivers and folds have no plane to move in.
        flat = np.einsum("ij,ij->i", around, normals) > _FLAT_COSINE
        way -= np.einsum("ij,ij->i", way, around)[:, None] * around
        surface = surface.moved(vertices + share * way * flat[:, None])
    return surface
