"""One closed outer surface around all layers, as a scanner would give it.

Every layer counts as a sheet of a certain thickness. Space that a ball of a certain size can reach
from outside is empty, all other space is solid; the boundary is extracted by marching cubes from
true distances, so it lies within a fraction of a voxel of the sheets. Hems can be capped, so that
the inside of sleeves, trouser legs and skirts, which no scanner sees, is solid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import Floats, Ints
from harness.core.arrays import Ints32
from harness.core.errors import DataError
from harness.geometry.coinciding import components, edges_of

_COARSE = 2
_PAD_M = 0.06
_FAR_M = 1.0
_TINY = 1e-6


@dataclass(frozen=True)
class Shell:
    """Size of the grid's cells, half the sheets' thickness, radius of the ball that looks for ways
    in, how far past its centre it still sees, and the number of faces to keep. Metres.
    """

    voxel: float = 0.0033
    half_thickness: float = 0.0024
    ball: float = 0.010
    sight: float = 0.018
    faces: int = 380_000


def cap(loop: Floats) -> tuple[Floats, Ints]:
    """A fan of triangles over a closed loop (N,3)."""
    n = len(loop)
    ring = np.arange(n)
    fan = np.stack([ring, np.roll(ring, -1), np.full(n, n)], axis=1)
    return np.concatenate([loop, loop.mean(0, keepdims=True)]), fan


def _sampled(vertices: Floats, faces: Ints, step: float) -> Floats:
    """Points (N,3) of every triangle, on a lattice no wider than ``step``."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    longest = np.max([np.linalg.norm(d, axis=1) for d in (a - b, b - c, c - a)], axis=0)
    parts = np.maximum(1, np.ceil(longest / step)).astype(int)
    out = []
    for n in np.unique(parts):
        m = parts == n
        lattice = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
        u, v = lattice[:, :1], lattice[:, 1:]
        start, first, second = a[m, None], (b - a)[m, None], (c - a)[m, None]
        out.append((start + first * u + second * v).reshape(-1, 3))
    return np.concatenate(out)


def _doubled(field: Floats) -> Floats:
    """A field on a grid of half the spacing, linear between the nodes."""
    for axis in range(3):
        size = field.shape[axis]
        place = np.arange(size * _COARSE) / _COARSE
        low = place.astype(int)
        shape = [1, 1, 1]
        shape[axis] = -1
        share = (place - low).reshape(shape).astype(np.float32)
        high = np.minimum(low + 1, size - 1)
        field = np.take(field, low, axis) * (1 - share) + np.take(field, high, axis) * share
    return field


def _marked(points: Floats, origin: Floats, spacing: float, shape: Ints) -> np.ndarray:
    out = np.zeros(shape, bool)
    index = np.clip(np.rint((points - origin) / spacing).astype(int), 0, np.array(shape) - 1)
    out[tuple(index.T)] = True
    return out


def _pieces(mask: np.ndarray) -> tuple[Ints, int]:
    """Connected pieces of a mask, numbered from 1, and how many there are."""
    from scipy import ndimage

    found: Any = ndimage.label(mask)
    return found


def _reachable(gate: np.ndarray, spacing: float, shell: Shell) -> Floats:
    """Signed distance (coarse grid) into the space that the ball sees from outside."""
    from scipy import ndimage

    to_gate: Any = ndimage.distance_transform_edt(~gate, sampling=spacing)
    pieces, _ = _pieces(to_gate > shell.ball)
    distance: Any = ndimage.distance_transform_edt(pieces != pieces[0, 0, 0], sampling=spacing)
    return (shell.sight - distance).astype(np.float32)


def _distance_field(near: Nearness, sheets: np.ndarray, origin: Floats, shell: Shell) -> Floats:
    """Distance to the sheets less their half thickness: exact near the surface to be extracted,
    interpolated or far elsewhere.
    """
    from scipy import ndimage

    spacing = shell.voxel * _COARSE
    band = ndimage.binary_dilation(sheets, np.ones((3, 3, 3)), iterations=2)
    coarse: Any = np.full(band.shape, _FAR_M, np.float32)
    coarse[band] = near.distance(origin + np.argwhere(band) * spacing) - shell.half_thickness
    field = _doubled(coarse)
    # A distance changes by no more than the way between two nodes, so beyond that no sign can turn.
    close = np.zeros(field.shape, bool)
    wanted = np.abs(coarse) < spacing * 1.05 + shell.voxel
    for offset in np.ndindex(_COARSE, _COARSE, _COARSE):
        close[tuple(slice(k, None, _COARSE) for k in offset)] = wanted
    close &= np.abs(field) < 2.2 * shell.voxel
    points = origin + np.argwhere(close) * shell.voxel
    field[close] = near.distance(points) - shell.half_thickness
    return field


def _emptiness(
    vertices: Floats, faces: Ints, caps: Sequence[tuple[Floats, Ints]], shell: Shell
) -> tuple[Floats, Floats]:
    """A field that is positive in empty space, metres, and the position (3,) of its first node."""
    origin = vertices.min(0) - _PAD_M
    spacing = shell.voxel * _COARSE
    shape = np.ceil((vertices.max(0) + _PAD_M - origin) / spacing).astype(int) + 1
    sheets = _marked(_sampled(vertices, faces, 0.7 * spacing), origin, spacing, shape)
    field = _distance_field(Nearness(vertices, faces), sheets, origin, shell)
    gate = sheets
    for cap_vertices, cap_faces in caps:
        gate = gate | _marked(
            _sampled(cap_vertices, cap_faces, 0.5 * spacing), origin, spacing, shape
        )
    return np.minimum(field, _doubled(_reachable(gate, spacing, shell))), origin


def _one_piece(field: Floats) -> Floats:
    """The field with enclosed cavities filled and loose crumbs removed."""
    empty, _ = _pieces(field > 0)
    outside = empty == empty[0, 0, 0]
    field = np.where(outside | (field <= 0), field, -1e-4)
    solid, _ = _pieces(~outside)
    largest = np.bincount(solid.ravel())[1:].argmax() + 1
    field = np.where(~outside & (solid != largest), 1e-3, field)
    return np.where(np.abs(field) < _TINY, -_TINY, field)


def _piece_of_face(faces: np.ndarray) -> Ints32:
    """The piece of each face (F,): faces that share an edge hang together.

    Open3D's own search takes four seconds.
    """
    of_side = edges_of(faces).of_side.ravel()
    order = np.argsort(of_side, kind="stable")
    same = np.flatnonzero(np.diff(of_side[order]) == 0)
    face = order // 3
    return components(len(faces), face[same], face[same + 1])


def _two_at_every_edge(mesh: Any) -> bool:
    return bool((edges_of(np.asarray(mesh.triangles)).counts == 2).all())


def outer_shell(
    vertices: Floats, faces: Ints, caps: Sequence[tuple[Floats, Ints]], shell: Shell
) -> tuple[Floats, Ints]:
    """Vertices and faces (F,3) of the closed surface around triangles, facing outward.

    caps: surfaces that close openings to the search from outside but are not part of the result.

    Raises:
        DataError: the result is not one closed surface without non-manifold edges.
    """
    import open3d as o3d
    from skimage.measure import marching_cubes

    field, origin = _emptiness(vertices, faces, caps, shell)
    points, triangles, _, _ = marching_cubes(_one_piece(field), 0.0, gradient_direction="ascent")
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(origin + points.astype(float) * shell.voxel),
        o3d.utility.Vector3iVector(triangles.astype(np.int32)),
    )
    if len(triangles) > shell.faces:
        mesh = mesh.simplify_quadric_decimation(shell.faces)
    mesh.remove_unreferenced_vertices()
    piece = _piece_of_face(np.asarray(mesh.triangles))
    sizes = np.bincount(piece)
    if len(sizes) > 1:
        mesh.remove_triangles_by_mask(piece != sizes.argmax())
        mesh.remove_unreferenced_vertices()
    if not (_two_at_every_edge(mesh) and mesh.is_vertex_manifold()):
        raise DataError(
            "the outer surface is not closed",
            expected="two faces at every edge, one fan at every vertex",
            got=f"{len(mesh.get_non_manifold_edges(False))} bad edges, "
            f"{len(mesh.get_non_manifold_vertices())} bad vertices",
        )
    out, out_faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64)
    volume = np.einsum(
        "fd,fd->", out[out_faces[:, 0]], np.cross(out[out_faces[:, 1]], out[out_faces[:, 2]])
    )
    return out, out_faces if volume > 0 else out_faces[:, ::-1]
