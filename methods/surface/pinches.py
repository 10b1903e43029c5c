"""Edges where two folds of a closed surface touch: cut apart, so that the surface is a manifold.

An isosurface may leave four faces at one edge where two folds pass within a cell of each other. It
is closed there, but a solver or a printer that asks for "the other face at this edge" has no
answer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.mesh import Mesh
from harness.geometry.topology import half_edges

#: How far the two middles of a cut edge move towards the faces they belong to.
_APART = 0.1


def without_pinches(mesh: Mesh) -> tuple[Mesh, int]:
    """The mesh with every edge of four faces cut in the middle, once for each fold; and how many.

    Each fold takes the two faces that have solid between them. Two faces back to back on the same
    three vertices are dropped first. Edges of more faces, and open ones, stay as they are.
    """
    mesh = _without_back_to_back(mesh)
    pinched = _pinched_edges(mesh)
    if not len(pinched):
        return mesh, 0
    vertices, faces = list(mesh.vertices), [tuple(face) for face in mesh.faces.tolist()]
    # Few edges among many faces: only their own faces are looked at.
    touched = set(np.flatnonzero(np.isin(mesh.faces, pinched).sum(axis=1) >= 2).tolist())
    for a, b in pinched.tolist():
        around = [index for index in touched if a in faces[index] and b in faces[index]]
        for pair in _folds(a, b, around, vertices, faces):
            middle = (vertices[a] + vertices[b]) / 2
            apexes = [vertices[_apex(faces[index], a, b)] for index in pair]
            vertices.append(middle + _APART * (np.mean(apexes, axis=0) - middle))
            for index in pair:
                first, second = _halves(faces[index], a, b, len(vertices) - 1)
                faces[index] = first
                faces.append(second)
                touched.add(len(faces) - 1)
    return replace(mesh, vertices=np.array(vertices), faces=np.array(faces)), len(pinched)


def _without_back_to_back(mesh: Mesh) -> Mesh:
    faces = mesh.faces.astype(np.int64)
    _, same, times = np.unique(
        np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    keep = times[same.ravel()] != 2
    return mesh if keep.all() else mesh.submesh(keep)


def _pinched_edges(mesh: Mesh) -> Ints:
    """(E, 2) edges along which two faces run each way."""
    start, end = half_edges(mesh.faces)
    count = len(mesh.vertices)
    there, times = np.unique(start * count + end, return_counts=True)
    twice = there[times == 2]
    edges = np.stack([twice // count, twice % count], axis=1)
    both = np.isin(edges[:, 1] * count + edges[:, 0], twice)
    return edges[both & (edges[:, 0] < edges[:, 1])]


def _apex(face: tuple[int, ...], a: int, b: int) -> int:
    return next(corner for corner in face if corner not in (a, b))


def _runs(face: tuple[int, ...], a: int, b: int) -> bool:
    """Whether the face runs from a to b, not from b to a."""
    return face[(face.index(a) + 1) % 3] == b


def _folds(
    a: int, b: int, around: list[int], vertices: list[Floats], faces: list[tuple[int, ...]]
) -> list[tuple[int, int]]:
    """The four faces at an edge as two pairs, each with solid between its faces."""
    ahead = [index for index in around if _runs(faces[index], a, b)]
    behind = [index for index in around if not _runs(faces[index], a, b)]
    edge = vertices[b] - vertices[a]
    edge = edge / np.linalg.norm(edge)

    def across(index: int) -> Floats:
        arm = vertices[_apex(faces[index], a, b)] - vertices[a]
        return arm - (arm @ edge) * edge

    level = across(ahead[0])
    inwards = np.cross(level, edge)  # against the outward normal, edge x level

    def turn(index: int) -> float:
        arm = across(index)
        return float(np.arctan2(arm @ inwards, arm @ level) % (2 * np.pi))

    partner = min(behind, key=turn)
    return [(ahead[0], partner), (ahead[1], behind[1 - behind.index(partner)])]


def _halves(
    face: tuple[int, ...], a: int, b: int, middle: int
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """A face cut from the middle of its edge to its apex, in the same orientation."""
    first, second = (
        tuple(middle if corner == end else corner for corner in face) for end in (b, a)
    )
    return first, second
