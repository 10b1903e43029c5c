"""What the sheets do not see: the body, fitted to the sheets, where they leave a gap.

ECON_EX's way (Xiu et al. 2023, section 3.3, without IF-Nets+): the body without the parts whose
detail it does not know, moved onto the sheets, minus all that the sheets show already. ECON moves
it by an affine map per vertex under four regularisers. Here each vertex slides along its own normal
by an offset that is smooth over the surface: one linear system, and between the front and the back
sheet, where nothing is seen, the body stands off by as much as the clothes do on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.geometry.surface import SurfaceIndex, vertex_normals
from harness.geometry.topology import edges_of


@dataclass(frozen=True, slots=True)
class CompletionParameters:
    """How the body is moved onto the sheets and cut.

    Attributes:
        reach_m: A sheet further than this from the body's surface does not pull on it.
        smoothness: Weight of the squared difference of neighbours' offsets, against 1 for the
            squared distance to the sheet.
        rounds: How often closest points are searched anew.
        covered_m: The body is dropped within this distance of the sheets; the published 2 cm.
    """

    reach_m: float = 0.10
    smoothness: float = 5.0
    rounds: int = 3
    covered_m: float = 0.02

    def __post_init__(self) -> None:
        if min(self.reach_m, self.smoothness, self.covered_m) <= 0 or self.rounds < 0:
            raise DataError(
                "the body cannot complete sheets with these parameters",
                expected="positive reach_m, smoothness and covered_m, rounds not negative",
                got=str(self),
            )


class BodyCompletion:
    """Completes sheets with the body."""

    def __init__(self, parameters: CompletionParameters | None = None) -> None:
        self.parameters = parameters or CompletionParameters()

    def __call__(self, sheets: Mesh, body: Mesh, omitted: Mask) -> Mesh | None:
        """Surface in the sheets' gaps, world metres, or None where they have none.

        Args:
            sheets: All sheets in one mesh.
            body: The fitted body.
            omitted: (V,) vertices of the body that must not stand in: face, hands, eyeballs.

        Raises:
            MethodError: every face of the body is omitted.
        """
        shell = without_vertices(body, omitted)
        if shell is None:
            raise MethodError("the body has no face left to complete the sheets with")
        index = SurfaceIndex(sheets)
        moved = registered(_subdivided(shell), index, self.parameters)
        _, distance = index.closest(moved.vertices)
        rest = without_vertices(moved, distance < self.parameters.covered_m)
        return None if rest is None else replace(rest, source="completion")


def registered(body: Mesh, sheets: SurfaceIndex, parameters: CompletionParameters) -> Mesh:
    """The body with each vertex moved along its normal, smoothly, towards the sheets."""
    stiff = stiffness(body, parameters.smoothness)
    for _ in range(parameters.rounds):
        normals = vertex_normals(body)
        offsets, trust = _pull(body.vertices, normals, sheets, parameters.reach_m)
        smooth = smooth_offsets(stiff, offsets, trust)
        body = Mesh(body.vertices + smooth[:, None] * normals, body.faces, source=body.source)
    return body


def stiffness(mesh: Mesh, smoothness: float):  # noqa: ANN201 - as ``_laplacian``
    """(V, V) matrix for ``smooth_offsets`` on a mesh of these faces.

    ``smoothness`` weighs the squared difference along an edge, against 1 for the squared distance
    to a given offset.
    """
    return smoothness * _laplacian(mesh)


def smooth_offsets(stiff: Any, offsets: Floats, trust: Floats) -> Floats:
    """Offsets (V,) near the given ones where these are trusted (V,), and like their neighbours'.

    A part where none is trusted has none. ``stiff`` is the mesh's ``stiffness``.
    """
    from scipy.sparse.linalg import splu

    system = stiff + _diagonal(trust + 1e-6)
    return splu(system.tocsc()).solve(trust * offsets)


def _pull(
    points: Floats, normals: Floats, sheets: SurfaceIndex, reach_m: float
) -> tuple[Floats, Floats]:
    """Offsets (V,) in metres along the normals to the closest sheet, and how far to believe each.

    A sheet that faces elsewhere is another part of the person, such as the trunk beside an arm. One
    that lies aside, as the rim does for all of a gap, says little about how far out the gap is.
    """
    found, distance = sheets.closest(points)
    agreement = np.einsum("ij,ij->i", normals, sheets.normals(found))
    offsets = np.einsum("ij,ij->i", found.points - points, normals)
    straight = offsets**2 / np.maximum(distance**2, 1e-12)
    near = np.clip(1.0 - distance / reach_m, 0.0, None)
    return offsets, np.clip(agreement, 0.0, None) * near * straight


def without_vertices(mesh: Mesh, dropped: Mask) -> Mesh | None:
    """The faces that have no dropped vertex (V,), or None if there is none."""
    keep = np.logical_not(np.any(dropped[mesh.faces], axis=1))
    return mesh.geometry().submesh(keep) if keep.any() else None


def _laplacian(mesh: Mesh):  # noqa: ANN202 - a scipy sparse matrix, whose stubs are partial
    """(V, V) sum of squared differences along edges, as a matrix."""
    from scipy.sparse import coo_matrix

    first, second = edges_of(mesh.faces).ends.T
    count = len(mesh.vertices)
    adjacency = coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    adjacency = adjacency + adjacency.T
    return _diagonal(np.asarray(adjacency.sum(axis=1)).ravel()) - adjacency


def _diagonal(values: Floats):  # noqa: ANN202
    from scipy.sparse import diags

    return diags(values)


def _subdivided(mesh: Mesh) -> Mesh:
    """Each triangle cut into four at the middles of its edges, as the published code does."""
    edges = edges_of(mesh.faces)
    middles = mesh.vertices[edges.ends].mean(axis=1)
    ab, bc, ca = (len(mesh.vertices) + edges.of_side).T
    a, b, c = mesh.faces.T
    triangles = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    faces = np.concatenate([np.stack(corners, axis=1) for corners in triangles])
    return Mesh(np.concatenate([mesh.vertices, middles]), faces, source=mesh.source)
