"""How far world points are inside or outside the outline that one photo shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Singles
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.geometry.hull import hull_distance
from harness.geometry.outline import Outline
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
