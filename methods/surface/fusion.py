"""Open surfaces to one closed mesh: screened Poisson reconstruction, its largest piece, checked.

Source: Kazhdan and Hoppe, "Screened Poisson surface reconstruction", TOG 2013, as Open3D has it;
ECON and MExECON end in the same step (depth 10, largest component, 50 000 faces).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from harness.core.arrays import Floats, Ints, Ints32, Mask
from harness.core.camera import Camera
from harness.core.errors import DataError, MethodError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import (
    concatenated,
    half_edges,
    largest_piece,
    open_edges,
    pieces_of,
)
from harness.geometry.surface import vertex_normals

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


#: The octree's side over the longest side of what is fused, and levels more that it then needs for
#: cells of about the same size. The bulge in a wide gap can reach the octree's wall, where the
#: surface stays open, as at the published 1.1: then the next one is tried.
OCTREES = ((1.25, 0), (2.5, 1), (5.0, 2))


@dataclass(frozen=True, slots=True)
class FusionParameters:
    """How the surfaces are fused.

    Attributes:
        depth: Depth of the octree; its finest cell is 1.25 times the longest side, divided by
            2^depth.
        faces: Decimate to about this many faces; 0 keeps all.
    """

    depth: int = 9
    faces: int = 0

    def __post_init__(self) -> None:
        if not 4 <= self.depth <= 12 or self.faces < 0:
            raise DataError(
                "surfaces cannot be fused with these parameters",
                expected="depth 4 to 12, faces not negative",
                got=str(self),
            )


def fused(parts: Sequence[Mesh], parameters: FusionParameters | None = None) -> Mesh:
    """One closed, outward-facing piece through the vertices of all parts, world metres.

    Args:
        parts: Surfaces that face outwards, open or closed.
        parameters: None takes the defaults.

    Raises:
        MethodError: the result is not closed, not consistently oriented, or encloses nothing.
    """
    rules = parameters or FusionParameters()
    mesh = _bounded(concatenated(parts), rules.depth)
    if rules.faces and len(mesh.faces) > rules.faces:
        mesh = one_piece(_decimated(mesh, rules.faces))
    return _closed(mesh)


def one_piece(mesh: Mesh) -> Mesh:
    """The largest piece of a closed surface, cut apart where its folds touch."""
    # Twice: a crumb that hung on by a fin without thickness is a piece of its own without it.
    return largest_piece(without_pinches(largest_piece(mesh))[0])


def _bounded(cloud: Mesh, depth: int) -> Mesh:
    """One piece that does not reach the octree's wall, or the last that was tried."""
    mesh = cloud
    for margin, levels in OCTREES:
        mesh = one_piece(_poisson(cloud, depth + levels, margin))
        if not open_edges(mesh):
            break
    return mesh


def _poisson(cloud: Mesh, depth: int, margin: float) -> Mesh:
    import open3d as o3d

    normals = vertex_normals(cloud)
    oriented = np.linalg.norm(normals, axis=1) > 0.5
    # Centred, because the solver works in float32.
    centre = cloud.bounds.mean(axis=0)
    points: Any = o3d.geometry.PointCloud()
    points.points = o3d.utility.Vector3dVector(cloud.vertices[oriented] - centre)
    points.normals = o3d.utility.Vector3dVector(normals[oriented])
    # Threads add sums in any order; one thread gives equal output for equal input.
    surface, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        points, depth=depth, scale=margin, n_threads=1
    )
    return _from_open3d(surface, centre, "fused surface")


def _decimated(mesh: Mesh, faces: int) -> Mesh:
    import open3d as o3d

    given: Any = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices), o3d.utility.Vector3iVector(mesh.faces)
    )
    smaller = given.simplify_quadric_decimation(target_number_of_triangles=faces)
    return _from_open3d(smaller, np.zeros(3), mesh.source)


def _from_open3d(surface: Any, centre: Floats, source: str) -> Mesh:
    faces = np.asarray(surface.triangles)
    if len(faces) == 0:
        raise MethodError(f"the {source} is empty", expected="triangles", got="none")
    return Mesh(np.asarray(surface.vertices) + centre, faces, source=source)


def _closed(mesh: Mesh) -> Mesh:
    open_count = open_edges(mesh)
    if open_count:
        raise MethodError(
            "the fused surface is not closed",
            expected="every edge between two faces of the same orientation",
            got=f"{open_count} other edges among {len(mesh.faces)} faces",
            hint="Look at the sheets and the completion with --keep",
        )
    if mesh.signed_volume <= 0:
        raise MethodError(
            "the fused surface faces inwards",
            expected="a positive volume",
            got=f"{mesh.signed_volume:g} m3",
        )
    return mesh


@dataclass(frozen=True, slots=True)
class SheetParameters:
    """Which triangles of a sheet are kept; the defaults are the published ones.

    Attributes:
        least_facing: A face is stretched, and dropped, when the cosine between its normal and the
            line of sight is not above this.
        least_component: A component is dropped when it holds no more than this share of vertices.
    """

    least_facing: float = 0.2
    least_component: float = 0.01


def front_back_sheets(
    front: ArrayLike,
    back: ArrayLike,
    camera: Camera,
    parameters: SheetParameters | None = None,
) -> tuple[Mesh, Mesh]:
    """The front and the back sheet as world meshes in metres, both facing outwards.

    Args:
        front: (H, W) depth in metres along the optical axis, NaN where there is no surface.
        back: (H, W) depth of the far side, seen by the same camera.
        camera: The camera of both maps; vertices are at its pixel centres.
        parameters: Which faces are kept; None takes the published rules.

    Raises:
        DataError: a map of another size than the camera, or one that leaves no triangle.
    """
    rules = parameters or SheetParameters()
    return (
        depth_sheet(front, camera, rules, away=False),
        depth_sheet(back, camera, rules, away=True),
    )


def depth_sheet(
    depth: ArrayLike, camera: Camera, parameters: SheetParameters, *, away: bool
) -> Mesh:
    """One depth map (H, W), metres, as a world mesh; it faces the camera, or away from it.

    Raises:
        DataError: a map of another size than the camera, or one that leaves no triangle.
    """
    depth = np.asarray(depth, dtype=np.float64)
    name = "back sheet" if away else "front sheet"
    if depth.shape != (camera.height, camera.width):
        raise DataError(
            f"{name} and camera do not match",
            expected=f"depth of shape {(camera.height, camera.width)}",
            got=str(depth.shape),
        )
    valid = np.isfinite(depth)
    faces = _grid_faces(valid, away)
    vertices = camera.unproject(camera.pixel_centres()[valid], depth[valid])
    keep = _facing(vertices, faces, camera) > parameters.least_facing
    keep[keep] = in_large_piece(faces[keep], parameters.least_component)
    if not keep.any():
        raise DataError(
            f"{name} has no triangle left",
            expected="at least one patch of four neighbouring pixels that faces the camera",
            got=f"{int(valid.sum())} pixels with depth",
            hint="Look at the normal maps and the silhouette",
        )
    return Mesh(vertices, faces, source=name).submesh(keep)


def in_large_piece(faces: Ints32, least_share: float) -> Mask:
    """(F,) whether a face's piece holds more than ``least_share`` of the vertices in use."""
    if len(faces) == 0:
        return np.zeros(0, dtype=bool)
    pieces = pieces_of(faces, int(faces.max()) + 1)
    share = pieces.vertex_counts / len(np.unique(faces))
    return share[pieces.of_face] > least_share


def _grid_faces(valid: Mask, away: bool) -> Ints32:
    """Two triangles per square of four valid pixels, counter-clockwise from outside.

    Indices count the valid pixels row by row.
    """
    index = np.cumsum(valid.ravel(), dtype=np.int32).reshape(valid.shape) - 1
    whole = valid[:-1, :-1] & valid[:-1, 1:] & valid[1:, :-1] & valid[1:, 1:]
    top_left, top_right = index[:-1, :-1][whole], index[:-1, 1:][whole]
    low_left, low_right = index[1:, :-1][whole], index[1:, 1:][whole]
    faces = np.concatenate(
        [
            np.stack([top_left, low_left, top_right], axis=1),
            np.stack([top_right, low_left, low_right], axis=1),
        ]
    )
    return faces[:, ::-1] if away else faces


def _facing(vertices: Floats, faces: Ints32, camera: Camera) -> Floats:
    """(F,) absolute cosine between each face's normal and the line of sight to its centre."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    middle = (a + b + c) / 3.0
    sight = middle - camera.eye_of(middle)
    length = np.linalg.norm(normal, axis=1) * np.linalg.norm(sight, axis=1)
    return np.abs(np.einsum("ij,ij->i", normal, sight)) / np.maximum(length, np.finfo(float).tiny)
