"""IF-Nets+ completes two sheets to a closed surface, as ECON's variant with a network does.

Source: Xiu et al., "ECON", CVPR 2023, section 3.3 (ECON_IF), and its public code: voxels of the
body and of both sheets in a cube, occupancy on a lattice, its surface decimated and smoothed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask, Singles
from harness.core.cameras.camera import Camera
from harness.core.mesh import Mesh
from harness.core.protocols import Part
from harness.geometry.topology import concatenated, edges_of
from methods.ifnet.contour import contoured_field
from methods.ifnet.cube import cube_around
from methods.ifnet.part import DECODER, ENCODER, IFNET
from methods.ifnet.voxels import body_voxels, sheet_voxels
from methods.parts.onnx_session import answers, open_session

#: Voxels and cells along each axis of the cube.
SIDE = 256
#: Points that are asked for at once; a million would take 2 GB.
_AT_ONCE = 1 << 16
#: The published size of the completed surface, and its smoothing.
_FACES = 50_000
_ALPHA, _BETA, _ROUNDS = 0.1, 0.5, 10


def ifnet_part() -> Part:
    """The imported network, as records name it.

    Raises:
        MissingPart: it is not imported, or a file is gone.
        DataError: a file is another one.
    """
    return IFNET.find().installed.part(IFNET.about.role)


def completed_by_network(
    sheets: tuple[Mesh, Mesh], body: Mesh, camera: Camera, side: int = SIDE
) -> Mesh:
    """The closed surface that the network makes of two sheets and a body, world metres.

    Args:
        sheets: Front and back, world metres.
        body: The fitted body without its eyeballs, world metres.
        camera: The front view's; the network looks along its axis.
        side: Voxels along each axis; the network was trained with 256.

    Raises:
        MissingPart, DataError: as ``ifnet_part``.
        MethodError: nothing is inside the surface.
    """
    cube = cube_around(camera, concatenated(sheets), body)
    front, back = (sheet.geometry().transformed(cube.from_world) for sheet in sheets)
    inner = body_voxels(body.geometry().transformed(cube.from_world), side)
    occupancy = Occupancy(sheet_voxels(front, back, side), inner)
    mesh = contoured_field(occupancy, side, occupancy.shown)
    return smoothed(_decimated(mesh)).transformed(cube.to_world)


class Occupancy:
    """The network's answer at any point of the cube, above one half inside.

    Args:
        sheets: (D, D, D) by (z, y, x), y downwards; see ``methods.ifnet.voxels``.
        body: (D, D, D) likewise.

    Raises:
        MissingPart, DataError: as ``ifnet_part``.
    """

    def __init__(self, sheets: Singles, body: Singles) -> None:
        stored = IFNET.find()
        shown = {"sheets": sheets[None], "body": body[None]}
        lattices = answers(open_session(stored.file(ENCODER)), "IF-Nets+", shown)
        named = {f"features_{level}": lattice for level, lattice in enumerate(lattices)}
        self._shown: dict[str, NDArray[np.float32]] = {"sheets": sheets[None], **named}
        self._decoder: Any = open_session(stored.file(DECODER))
        #: (D, D, D) by (x, y, z), y upwards: voxels with a body or a sheet in them.
        self.shown: Mask = ((sheets > 0) | (body > 0))[:, ::-1].transpose(2, 1, 0)

    def __call__(self, points: Floats) -> Singles:
        """(N,) occupancies at points (N, 3) of the cube: x right, y up, z towards the viewer."""
        asked = (points * (1.0, -1.0, 1.0)).astype(np.float32)
        found = np.empty(len(asked), dtype=np.float32)
        for start in range(0, len(asked), _AT_ONCE):
            some = slice(start, start + _AT_ONCE)
            feeds = {"points": asked[None, some], **self._shown}
            (found[some],) = answers(self._decoder, "IF-Nets+", feeds)[0]
        return found


def _decimated(mesh: Mesh) -> Mesh:
    import open3d as o3d

    if len(mesh.faces) <= _FACES:
        return mesh
    given: Any = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices), o3d.utility.Vector3iVector(mesh.faces)
    )
    smaller = given.simplify_quadric_decimation(target_number_of_triangles=_FACES)
    return Mesh(np.asarray(smaller.vertices), np.asarray(smaller.triangles), source=mesh.source)


def smoothed(mesh: Mesh, alpha: float = _ALPHA, beta: float = _BETA, rounds: int = _ROUNDS) -> Mesh:
    """A surface without its small bumps, which keeps its volume better than by plain averaging.

    Source: Vollmer, Mencl, Mueller, "Improved Laplacian smoothing of noisy surface meshes", 1999:
    after each averaging a vertex goes back by what it and its neighbours were moved.

    Args:
        mesh: The surface.
        alpha: Share of the first positions in what a vertex is called back to.
        beta: Share of a vertex' own move in what it goes back by; the rest is its neighbours'.
        rounds: How often.
    """
    from scipy.sparse import coo_matrix, diags

    first, second = edges_of(mesh.faces).ends.T
    count = len(mesh.vertices)
    joined = coo_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    joined = (joined + joined.T).tocsr()
    mean = diags(1.0 / np.maximum(np.asarray(joined.sum(axis=1)).ravel(), 1.0)) @ joined
    given, vertices = mesh.vertices, mesh.vertices
    for _ in range(rounds):
        before = vertices
        vertices = mean @ before
        moved = vertices - (alpha * given + (1.0 - alpha) * before)
        vertices = vertices - (beta * moved + (1.0 - beta) * (mean @ moved))
    return Mesh(vertices, mesh.faces, source=mesh.source)
