"""The current body as a surface that rays can ask: who is in front, where its outline runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from harness.geometry.topology import edges_of

if TYPE_CHECKING:
    from torch import Tensor


class Topology:
    """What does not change while the body moves: faces, edges, and the two faces of each edge.

    Attributes:
        faces: (F, 3) vertex indices.
        edges: (E, 2) vertex indices, each edge once.
        sides: (E, 2) faces at each edge; the second is -1 at a border.
    """

    def __init__(self, faces: NDArray[np.integer[Any]]) -> None:
        import torch

        self.faces = np.asarray(faces, dtype=np.int64)
        self.faces_tensor = torch.from_numpy(self.faces)
        edges = edges_of(self.faces)
        self.edges: Ints = edges.ends
        # A third face at an edge is not looked at: bodies have none.
        self.sides: Ints = edges.faces()


class BodySurface:
    """One body's surface at one moment of the fit; made anew after every step."""

    def __init__(self, vertices: Floats, topology: Topology) -> None:
        self.vertices = vertices
        self.topology = topology
        self.caster = Raycaster(Mesh(vertices=vertices, faces=topology.faces, source="body"))
        corners = vertices[topology.faces]
        self._normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._heights = np.einsum("fk,fk->f", self._normals, corners[:, 0])

    def contour(self, position: Floats) -> tuple[Ints, Ints]:
        """Edges where the surface turns away from a camera at ``position`` (3,), world metres.

        Returns:
            (C,) indices of edges and (C,) for each the face that is seen.
        """
        toward = self._normals @ position > self._heights
        first, second = self.topology.sides.T
        first_seen = toward[first]
        second_seen = np.where(second >= 0, toward[second], ~first_seen)
        edges = np.flatnonzero(first_seen != second_seen)
        # At a border the only face there is lies on the body's side, whichever way it looks.
        takes_first = first_seen[edges] | (second[edges] < 0)
        return edges, np.where(takes_first, first[edges], second[edges])


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """(V, 3) unit normals of one body, the area-weighted mean of its faces', differentiable.

    Twin of ``harness.geometry.surface.vertex_normals`` for surfaces without split vertices.
    """
    import torch

    corners = vertices[faces]
    normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = torch.zeros_like(vertices)
    for corner in range(3):
        total = total.index_add(0, faces[:, corner], normals)
    return torch.nn.functional.normalize(total, dim=1, eps=1e-12)
