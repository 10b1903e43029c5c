"""Finer triangles on the same surface, so that vertex colours hold what photos show."""

from __future__ import annotations

import numpy as np

from harness.core.arrays import AnyInts, Floats
from harness.core.mesh import Mesh
from harness.geometry.topology import edges_of

_NEAREST = float(np.sqrt(2.0))


def finer(mesh: Mesh, edge_m: float, most_vertices: int) -> Mesh:
    """The same surface with each face cut into four, and again, until edges are short enough.

    A closed surface stays closed. Texture is dropped.

    Args:
        mesh: World metres.
        edge_m: Wanted median edge. A cut halves it, so that it ends between 0.7 and 1.4 times as
            long, or is shorter because it was.
        most_vertices: The surface is not cut again where it would have more.
    """
    vertices, faces = mesh.vertices, mesh.faces
    while True:
        edges = edges_of(faces)
        if (
            len(vertices) + len(edges.ends) > most_vertices
            or _median(vertices, edges.ends) <= edge_m
        ):
            return Mesh(vertices, faces, source=mesh.source)
        ab, bc, ca = (edges.of_side + len(vertices)).T
        a, b, c = faces.T
        vertices = np.concatenate([vertices, vertices[edges.ends].mean(axis=1)])
        corners = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        faces = np.concatenate([np.stack(each, axis=1) for each in corners])


def _median(vertices: Floats, ends: AnyInts) -> float:
    return float(np.median(np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)))
