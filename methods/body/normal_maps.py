"""The body's normal map in a view, differentiable at every pixel.

Which triangle a pixel sees is found by a ray; where on it, and with which normal, is computed again
from the vertices, so that the gradient is that of the picture at the pixel and not that of a point
that moves with the skin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from methods.body.projection import Projector
from methods.body.surface import BodySurface, vertex_normals

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["NormalTarget", "normal_cost", "seen_normals"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NormalTarget:
    """What the normals of a view should be.

    Attributes:
        projector: The view.
        normals_camera: (H, W, 3) unit, x right, y up, z towards the viewer; 0 off the subject.
        area_px: What the cost is divided by: square of the subject's frame, pixels.
        most_pixels: A regular subset of no more than this many pixels is looked at.
    """

    projector: Projector
    normals_camera: Floats
    area_px: float
    most_pixels: int = 4000


def normal_cost(vertices: Tensor, surface: BodySurface, target: NormalTarget) -> Tensor:
    """Mean absolute difference of normals where body and subject overlap, as a share of the frame.

    Source: MExECON, equation of the normal loss (L1); mean over the three components as in ECON.
    """
    import torch

    camera = target.projector.camera
    hits = surface.caster.cast(camera)
    known = hits.mask & (np.abs(target.normals_camera).sum(axis=2) > 0)
    rows, columns = np.nonzero(known)
    if not len(rows):
        return vertices.sum() * 0.0
    step = -(-len(rows) // target.most_pixels)
    rows, columns = rows[::step], columns[::step]
    pixels = np.stack([columns, rows], axis=1) + 0.5
    normals = seen_normals(vertices, surface, hits.face[rows, columns], pixels, target.projector)
    wanted = torch.from_numpy(target.normals_camera[rows, columns]).to(normals)
    return (normals - wanted).abs().mean(1).sum() * (step / target.area_px)


def seen_normals(
    vertices: Tensor,
    surface: BodySurface,
    faces: NDArray[np.integer],
    pixels: Floats,
    projector: Projector,
) -> Tensor:
    """(N, 3) unit smooth normals, map frame, where rays through pixels (N, 2) meet faces (N,)."""
    import torch

    camera = projector.camera
    index = surface.topology.faces_tensor.to(vertices.device)
    corners = index[torch.from_numpy(np.asarray(faces, dtype=np.int64)).to(vertices.device)]
    a, b, c = vertices[corners].unbind(1)
    ray = torch.from_numpy(camera.ray_directions(pixels)).to(vertices)
    eye = torch.from_numpy(camera.position.copy()).to(vertices)
    # Möller and Trumbore: barycentric weights of a ray's hit as ratios of triple products.
    edge_b, edge_c, to_eye = b - a, c - a, eye - a
    across = torch.linalg.cross(ray, edge_c)
    volume = (edge_b * across).sum(1)
    volume = torch.where(volume.abs() < 1e-12, torch.full_like(volume, 1e-12), volume)
    weight_b = (to_eye * across).sum(1) / volume
    weight_c = (ray * torch.linalg.cross(to_eye, edge_b)).sum(1) / volume
    weights = torch.stack([1 - weight_b - weight_c, weight_b, weight_c], 1)
    normals = vertex_normals(vertices, index)
    blended = (weights[..., None] * normals[corners]).sum(1)
    seen = projector.turn(torch.nn.functional.normalize(blended, dim=1, eps=1e-12))
    return seen * torch.tensor([1.0, -1.0, -1.0]).to(seen)
