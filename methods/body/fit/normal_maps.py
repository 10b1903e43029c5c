"""The body's normal map in a view, differentiable at every pixel.

Which triangle a pixel sees is found by a ray; where on it, and with which normal, is computed again
from the vertices, so that the gradient is that of the picture at the pixel and not that of a point
that moves with the skin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.geometry.raycast import Hits
from methods.body.fit.evidence import Projector

if TYPE_CHECKING:
    from torch import Tensor


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
        most_pixels: A regular subset of no more than this many pixels is looked at.
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

    known = hits.mask & (np.abs(target.normals_camera).sum(axis=2) > 0)
    rows, columns = np.nonzero(known)
    if not len(rows):
        return skin.vertices.sum() * 0.0
    step = -(-len(rows) // target.most_pixels)
    rows, columns = rows[::step], columns[::step]
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
