"""The terms of JMBO's cost: one function for each, all of one shape.

A term takes the body and what one view asks of it, and returns one number without a weight. The
head's term is of the body alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.geometry.raycast import Hits
from methods.body.fit.evidence import length
from methods.body.fit.normal_maps import NormalTarget, Skin, normal_cost
from methods.body.fit.projection import Projector
from methods.body.fit.silhouette import SilhouetteTarget, silhouette_cost
from methods.body.fit.surface import BodySurface
from methods.body.models.model import ParametricBody, Posed

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkTarget:
    """Where a view's landmarks should be seen.

    Attributes:
        projector: The view.
        pixels: (K, 2) working pixels.
        weight: (K,) confidence of each landmark that counts, 0 for the others.
        side_px: Side of the subject's frame, which the cost is divided by.
    """

    projector: Projector
    pixels: Tensor
    weight: Tensor
    side_px: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class ViewTarget:
    """What one view asks of the body; ``normals`` is None where the view has none."""

    silhouette: SilhouetteTarget
    landmarks: LandmarkTarget
    normals: NormalTarget | None


@dataclass(frozen=True, slots=True, eq=False)
class BodyState:
    """The body at one iteration, world metres.

    Attributes:
        skin: Its vertices, their normals and its faces.
        points: (K, 3) its landmarks.
        surface: The same vertices as a surface that rays can meet.
        hits: What the rays of the view meet, where they have been cast already.
    """

    skin: Skin
    points: Tensor
    surface: BodySurface
    hits: Hits | None = None


def silhouette_term(body: BodyState, view: ViewTarget) -> Tensor:
    """Area between the two silhouettes, as a share of the subject's frame.

    Source: MExECON, equation of the silhouette loss (L1).
    """
    mask = None if body.hits is None else body.hits.mask
    return silhouette_cost(body.skin.vertices, body.surface, view.silhouette, mask)


def normal_term(body: BodyState, view: ViewTarget) -> Tensor:
    """Mean absolute difference of normals where body and subject overlap; 0 without normals.

    Source: MExECON, equation of the normal loss (L1).
    """
    if view.normals is None:
        return body.skin.vertices.sum() * 0.0
    hits = body.hits or body.surface.caster.cast(view.normals.projector.camera)
    return normal_cost(body.skin, hits, view.normals)


def landmark_term(body: BodyState, view: ViewTarget) -> Tensor:
    """Mean distance of landmarks in the picture, in sides of the subject's frame.

    Source: MExECON, equation of the landmark loss: mean of distances weighted by confidence, whose
    picture is one unit wide in the authors' code.
    """
    target = view.landmarks
    distance = length(target.projector(body.points) - target.pixels)
    weight = target.weight
    return (weight * distance).sum() / weight.sum().clamp_min(1e-6) / target.side_px


def head_cost(body: ParametricBody, posed: Posed) -> Tensor:
    """1 - cosine between the head's own upward axis and the world's.

    Source: MExECON, equation of the head loss, with both vectors of unit length.
    """
    return 1.0 - posed.turns[0, body.roles["head"], 1, 1]
