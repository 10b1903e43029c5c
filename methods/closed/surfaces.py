"""A closed mesh with all that one round of the fusion asks of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from harness.core.arrays import AnyInts, Floats, Ints, Singles
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.coinciding import edges_of
from harness.geometry.outline import Outline, hull_distance
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window

#: Pixels kept around the subject's box. Points that are seen further out get the distance of the
#: window's border, which is far outside for every use of it here.
_MARGIN_PX = 64
#: Step for the slope of the distance, metres: half of the way between the two points compared.
_SLOPE_STEP_M = 0.003
#: What lies further than this outside one view is not asked of the next, metres.
_OUTSIDE_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class SignedOutline:
    """Signed distance to a subject's outline in one photo, positive inside.

    Attributes:
        camera: Camera of the photo's window that holds the subject.
        distance_px: (H, W) of that window, pixels.
    """

    camera: Camera
    distance_px: Singles

    @property
    def plain(self) -> Outline:
        """The outline as the rest of the house has it, to whole pixels."""
        return Outline(self.camera, (self.distance_px > 0).astype(np.float64))

    def distances_px(self, points_world: Floats) -> Floats:
        """(N,) signed distances of the projections of world points (N, 3), pixels.

        Points at or behind the camera are as far outside as the window tells.
        """
        return self._sampled(points_world)[0]

    def distances_m(self, points_world: Floats) -> Floats:
        """(N,) signed distances of world points (N, 3) to the outline's cone, at their depth."""
        distance_px, depth = self._sampled(points_world)
        return distance_px * np.abs(self.camera.spread(depth)) / self.camera.K[0, 0]

    def slopes(self, points_world: Floats, directions: Floats) -> Floats:
        """(N,) change of ``distances_m`` per metre from points (N, 3) along unit directions."""
        ahead = self.distances_m(points_world + _SLOPE_STEP_M * directions)
        behind = self.distances_m(points_world - _SLOPE_STEP_M * directions)
        return (ahead - behind) / (2 * _SLOPE_STEP_M)

    def inward(self, points_world: Floats) -> Floats:
        """(N, 3) unit world directions, parallel to the picture, in which the distance grows.

        Zero where it grows nowhere, as along the middle line of a limb.
        """
        rows = self.camera.rotation[:2]
        right, down = (np.broadcast_to(row, points_world.shape) for row in rows)
        towards = np.stack(
            [self.slopes(points_world, right), self.slopes(points_world, down)], axis=1
        )
        length = np.linalg.norm(towards, axis=1, keepdims=True)
        return (towards / np.where(length > 0, length, 1.0)) @ rows

    def _sampled(self, points_world: Floats) -> tuple[Floats, Floats]:
        from scipy.ndimage import map_coordinates

        pixels, depth = self.camera.project(points_world)
        rows_columns = np.nan_to_num(pixels[:, ::-1].T - 0.5, nan=-1.0)
        found = map_coordinates(self.distance_px, rows_columns, order=1, mode="nearest")
        return found.astype(np.float64), depth


def signed_outline(camera: Camera, coverage: Floats) -> SignedOutline:
    """The outline of a subject, placed within pixels by their coverage.

    Beyond the frame the mask continues as at its border, so that the frame is no outline where it
    cuts the subject.

    Args:
        camera: The photo's camera.
        coverage: (H, W) share of each pixel that shows the subject, 0 to 1.

    Raises:
        MethodError: coverage of another size than the camera's, or no pixel shows the subject.
    """
    if coverage.shape != (camera.height, camera.width):
        raise MethodError(
            "a mask is not of its camera's size",
            expected=f"{camera.width} x {camera.height} pixels",
            got=f"{coverage.shape[1]} x {coverage.shape[0]}",
        )
    outline = Outline(camera, coverage)
    if outline.is_empty:
        raise MethodError("the mask shows no subject", expected="a mask that is not empty")
    box = outline.box
    left, top = max(box.left - _MARGIN_PX, 0), max(box.top - _MARGIN_PX, 0)
    right = min(box.right + _MARGIN_PX, camera.width)
    bottom = min(box.bottom + _MARGIN_PX, camera.height)
    part = outline.cropped(Window(left, top, right - left, bottom - top))
    return SignedOutline(part.camera, part.distance_px)


def outlines_distance(outlines: Sequence[SignedOutline], points: Floats) -> Singles:
    """(N,) least signed distance of world points (N, 3) to the outlines' cones, metres.

    Only an upper bound for points that are well outside one of them.
    """
    return hull_distance([outline.distances_m for outline in outlines], points, _OUTSIDE_M)


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
