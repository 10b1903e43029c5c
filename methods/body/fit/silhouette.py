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
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.geometry.images import sampled
from harness.geometry.outline import inner_depth_px
from methods.body.fit.projection import Projector
from methods.body.fit.surface import BodySurface

if TYPE_CHECKING:
    from torch import Tensor

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
    edges, faces = surface.contour(camera.position)
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
