"""What photos and the mesh itself tell of a reconstruction, without any scan.

``metrics.photos`` makes these numbers, ``photos.json`` beside a record keeps them, and tables show
them. Every value goes to JSON and back by ``harness.core.typed_json``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import fmean
from typing import TypeVar

from harness.core.records import AngularErrors

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Likeness:
    """How alike a photo and a rendered view are where both show the subject."""

    psnr_db: float
    """Peak signal to noise ratio of sRGB in [0, 1], decibels; more is better."""
    ssim: float | None
    """Mean structural similarity, -1 to 1; None where no window lies within both."""
    pixels: int
    """Pixels in both masks."""


@dataclass(frozen=True, slots=True)
class ViewScore:
    """What one photo tells."""

    view: int
    """Index of the photo, counted from the front."""
    silhouette_iou: float
    """Intersection over union of the mesh's silhouette and the photo's mask, 0 to 1."""
    given: Likeness | None
    """Of the mesh coloured from all photos; None where mesh and mask share no pixel."""
    held_out: Likeness | None
    """Of the mesh coloured from the other photos; None where this photo was not left out."""


@dataclass(frozen=True, slots=True)
class MapAgreement:
    """How far the mesh's normals are from the normal map that the method worked with."""

    view: int
    """Index of the photo, counted from the front."""
    errors: AngularErrors
    """Over the pixels in both masks."""


@dataclass(frozen=True, slots=True)
class Soundness:
    """Whether the mesh is a closed surface that does not cross itself."""

    faces: int
    open_edges: int
    """Edges that do not join exactly two faces that agree in direction; vertices at one place
    count as one."""
    self_intersecting_faces: int
    """Faces that an edge of another face crosses, and the faces of these edges."""

    @property
    def watertight(self) -> bool:
        """Whether every edge joins exactly two faces that agree in direction."""
        return self.open_edges == 0


@dataclass(frozen=True, slots=True)
class PhotoScores:
    """Every figure of one reconstruction that needs no scan."""

    views: tuple[ViewScore, ...]
    soundness: Soundness
    maps: tuple[MapAgreement, ...]
    """Empty for a method without normal maps."""
    seen_share: float
    """Share of the coloured vertices that a photo shows, 0 to 1."""

    @property
    def mean_iou(self) -> float:
        """Mean silhouette IoU over the views."""
        return fmean(view.silhouette_iou for view in self.views)

    @property
    def worst_iou(self) -> float:
        """The lowest silhouette IoU of a view."""
        return min(view.silhouette_iou for view in self.views)

    @property
    def psnr_db(self) -> float | None:
        """Mean over the views of the mesh coloured from all photos."""
        return _mean(self.views, lambda view: view.given and view.given.psnr_db)

    @property
    def ssim(self) -> float | None:
        """Likewise."""
        return _mean(self.views, lambda view: view.given and view.given.ssim)

    @property
    def held_out_psnr_db(self) -> float | None:
        """Mean over the views that were left out in turn."""
        return _mean(self.views, lambda view: view.held_out and view.held_out.psnr_db)

    @property
    def held_out_ssim(self) -> float | None:
        """Likewise."""
        return _mean(self.views, lambda view: view.held_out and view.held_out.ssim)

    @property
    def normal_agreement_deg(self) -> float | None:
        """Mean angle between the mesh's normals and the maps, over the maps."""
        return _mean(self.maps, lambda each: each.errors.mean_deg)


def _mean(parts: tuple[T, ...], read: Callable[[T], float | None]) -> float | None:
    """The mean over the parts that tell; None where none does."""
    values = [value for value in map(read, parts) if value is not None]
    return fmean(values) if values else None
