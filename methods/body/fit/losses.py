"""The area between two silhouettes, with its exact gradient.

Where the body covers the picture, the cost of a pixel is one thing, where it does not, another; the
total changes only as the outline moves. By Reynolds' transport theorem its derivative is the
integral along the outline of the jump in cost times the outline's speed along its outward normal
(Li et al. 2018, "Differentiable Monte Carlo ray tracing through edge sampling", sample the same
integral). The outline is made of mesh edges, so the integral is a sum over them; nothing is blurred
and nothing has to be tuned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.coinciding import edges_of
from harness.geometry.images import sampled
from harness.geometry.outline import inner_depth_px
from harness.geometry.raycast import Hits, Raycaster
from methods.body.fit.evidence import Projector

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

    def contour(self, camera: Camera) -> tuple[Ints, Ints]:
        """Edges where the surface turns away from a camera.

        Returns:
            (C,) indices of edges and (C,) for each the face that is seen.
        """
        if camera.is_orthographic:
            toward = self._normals @ camera.forward < 0
        else:
            toward = self._normals @ camera.position > self._heights
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


#: How far outside an edge a ray is sent to see whether the edge is on the outline, pixels.
_OUTSIDE_PX = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class SilhouetteTarget:
    """What a silhouette should look like.

    Attributes:
        projector: The view.
        coverage: (H, W) of the subject, from 0 to 1.
        area_px: What the cost is divided by: square of the subject's frame, pixels.
        missing: (H, W) cost of a pixel that the body does not cover: the coverage itself for the
            paper's L1, less where clothes may stand off the body.
    """

    projector: Projector
    coverage: Floats
    area_px: float
    missing: Floats

    def value(self, mask: NDArray[np.bool_]) -> float:
        """The cost of a body's mask (H, W)."""
        beyond = (1.0 - self.coverage)[mask].sum()
        return float(beyond + self.missing[~mask].sum()) / self.area_px


def uncovered_cost(coverage: Floats, weight: float, standoff_px: float) -> Floats:
    """(H, W) cost of each pixel of a clothed subject that a body does not cover.

    Args:
        coverage: (H, W) from 0 to 1.
        weight: Cost of a pixel well inside the subject.
        standoff_px: A rim of this width costs nothing: soles, hair and cloth lie outside the body.
    """
    if standoff_px <= 0:
        return weight * coverage
    # Beyond the frame the subject goes on, so that no rim starts where a picture cuts it.
    depth_px = inner_depth_px(coverage > 0.5)
    return weight * np.clip(depth_px - standoff_px + 0.5, 0.0, 1.0)


def silhouette_cost(
    vertices: Tensor,
    surface: BodySurface,
    target: SilhouetteTarget,
    mask: NDArray[np.bool_] | None = None,
) -> Tensor:
    """The target's cost of a body, differentiable in its vertices (V, 3), world metres.

    Args:
        vertices: With gradient; the same numbers that ``surface`` was made of.
        surface: Answers the rays.
        target: The view and its coverage.
        mask: (H, W) of the body in that view, where it is known already.
    """
    import torch

    camera = target.projector.camera
    value = target.value(surface.caster.mask(camera) if mask is None else mask)
    edges, faces = surface.contour(camera)
    ends = surface.topology.edges[edges]
    start, stop, third = _projected(surface, ends, faces, target.projector)
    along = stop - start
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)  # as long as the edge
    normal *= np.where(((third - start) * normal).sum(axis=1) > 0, -1.0, 1.0)[:, None]
    length = np.linalg.norm(normal, axis=1)
    middle = (start + stop) / 2
    outside = middle + _OUTSIDE_PX * normal / np.where(length > 0, length, 1.0)[:, None]
    inside_frame = ((middle > 0) & (middle < (camera.width, camera.height))).all(axis=1)
    kept = np.flatnonzero(inside_frame & (length > 0))
    kept = kept[~surface.caster.meets(outside[kept], camera)]
    jump = sampled(1.0 - target.coverage - target.missing, middle[kept])
    force = jump[:, None] * normal[kept] / target.area_px
    moving = target.projector(vertices[torch.from_numpy(ends[kept]).to(vertices.device)]).mean(1)
    push = (torch.from_numpy(force).to(moving) * moving).sum()
    # The value is the pixels', the gradient the outline's.
    return push - push.detach() + value


def _projected(
    surface: BodySurface, ends: NDArray[np.int64], faces: NDArray[np.int64], projector: Projector
) -> tuple[Floats, Floats, Floats]:
    """Pixels (C, 2) of both ends of the edges, and of the third corner of their faces."""
    corners = surface.topology.faces[faces]
    third = corners[(corners != ends[:, :1]) & (corners != ends[:, 1:])]
    used, index = np.unique(np.concatenate([ends.ravel(), third]), return_inverse=True)
    pixels, _ = projector.camera.project(surface.vertices[used])
    pixels = np.nan_to_num(pixels, nan=-1e6)[index]
    pairs = pixels[: 2 * len(ends)].reshape(-1, 2, 2)
    return pairs[:, 0], pairs[:, 1], pixels[2 * len(ends) :]


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """One body's vertices (V, 3) and vertex normals (V, 3), world frame, and its faces (F, 3)."""

    vertices: Tensor
    normals: Tensor
    faces: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class NormalTarget:
    """What the normals of a view should be.

    Attributes:
        projector: The view.
        normals_camera: (H, W, 3) unit, x right, y up, z towards the viewer; 0 off the subject.
        area_px: What the cost is divided by: square of the subject's frame, pixels.
        most_pixels: A regular subset of no more than this many of these pixels is looked at.
    """

    projector: Projector
    normals_camera: Floats
    area_px: float
    most_pixels: int = 2500


def normal_cost(skin: Skin, hits: Hits, target: NormalTarget) -> Tensor:
    """Mean absolute difference of normals where body and subject overlap, as a share of the frame.

    Args:
        skin: The body.
        hits: Where the rays of the target's view meet the body.
        target: What its normals should be.

    Source: MExECON, equation of the normal loss (L1); mean over the three components as in ECON.
    """
    import torch

    rows, columns = np.nonzero(np.abs(target.normals_camera).sum(axis=2) > 0)
    step = max(1, -(-len(rows) // target.most_pixels))
    # Of the subject's pixels and not of those that overlap, or one more of these moves them all.
    rows, columns = rows[::step], columns[::step]
    met = hits.mask[rows, columns]
    if not met.any():
        return skin.vertices.sum() * 0.0
    rows, columns = rows[met], columns[met]
    pixels = np.stack([columns, rows], axis=1) + 0.5
    normals = seen_normals(skin, hits.face[rows, columns], pixels, target.projector)
    wanted = torch.from_numpy(target.normals_camera[rows, columns]).to(normals)
    return (normals - wanted).abs().mean(1).sum() * (step / target.area_px)


def seen_normals(
    skin: Skin, faces: NDArray[np.integer[Any]], pixels: Floats, projector: Projector
) -> Tensor:
    """(N, 3) unit smooth normals, map frame, where rays through pixels (N, 2) meet faces (N,)."""
    import torch

    camera = projector.camera
    device = skin.vertices.device
    corners = skin.faces[torch.from_numpy(np.asarray(faces, dtype=np.int64)).to(device)]
    a, b, c = skin.vertices[corners].unbind(1)
    ray = torch.from_numpy(camera.ray_directions(pixels)).to(a)
    eye = torch.from_numpy(camera.ray_origins(pixels).copy()).to(a)
    # Möller and Trumbore: barycentric weights of a ray's hit as ratios of triple products.
    edge_b, edge_c, to_eye = b - a, c - a, eye - a
    across = torch.linalg.cross(ray, edge_c)
    volume = (edge_b * across).sum(1)
    volume = torch.where(volume.abs() < 1e-12, torch.full_like(volume, 1e-12), volume)
    weight_b = (to_eye * across).sum(1) / volume
    weight_c = (ray * torch.linalg.cross(to_eye, edge_b)).sum(1) / volume
    weights = torch.stack([1 - weight_b - weight_c, weight_b, weight_c], 1)
    blended = (weights[..., None] * skin.normals[corners]).sum(1)
    seen = projector.turn(torch.nn.functional.normalize(blended, dim=1, eps=1e-12))
    return seen * torch.tensor([1.0, -1.0, -1.0]).to(seen)
