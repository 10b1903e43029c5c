"""How well a surface fills the silhouettes that it was made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from methods.closed.outlines import SignedOutline
from methods.nview.views import FusionView


@dataclass(frozen=True, slots=True)
class SilhouetteFit:
    """A surface's own silhouettes against the given ones, by view.

    Attributes:
        covered: Share of the given silhouette that the surface covers.
        iou: Intersection over union of the two.
    """

    covered: tuple[float, ...]
    iou: tuple[float, ...]

    def details(self) -> dict[str, float]:
        """Plain JSON values for a record's reader: means over the views, and the worst view's."""
        return {
            "iou": round(float(np.mean(self.iou)), 4),
            "worst_iou": round(min(self.iou), 4),
            "covered": round(float(np.mean(self.covered)), 4),
            "worst_covered": round(min(self.covered), 4),
        }

    def lost_since(self, before: SilhouetteFit) -> float:
        """The largest share of a silhouette that is covered no more, 0 to 1."""
        return max(0.0, *(a - b for a, b in zip(before.covered, self.covered, strict=True)))


def silhouette_fit(mesh: Mesh, views: Sequence[FusionView], pixel_m: float) -> SilhouetteFit:
    """How well a mesh fills the silhouettes of all views, on pixels of about ``pixel_m``."""
    caster, centre = Raycaster(mesh), mesh.bounds.mean(axis=0)
    covered: list[float] = []
    iou: list[float] = []
    for view in views:
        outline = coarser(view.outline, centre, pixel_m)
        given, own = outline.distance_px > 0, caster.mask(outline.camera)
        both = float((given & own).sum())
        covered.append(both / max(1, int(given.sum())))
        iou.append(both / max(1, int((given | own).sum())))
    return SilhouetteFit(tuple(covered), tuple(iou))


def coarser(outline: SignedOutline, centre: Floats, pixel_m: float) -> SignedOutline:
    """An outline on pixels that are ``pixel_m`` large at a place (3,), never enlarged."""
    camera = outline.camera
    depth_m = float(camera.forward @ (centre - camera.position))
    scale = min(1.0, depth_m / float(camera.K[0, 0]) / pixel_m)
    width, height = (max(1, round(scale * side)) for side in camera.size)
    rows = ((np.arange(height) + 0.5) / height * camera.height).astype(np.int64)
    columns = ((np.arange(width) + 0.5) / width * camera.width).astype(np.int64)
    return SignedOutline(
        camera.resized(width, height), outline.distance_px[np.ix_(rows, columns)] * scale
    )
