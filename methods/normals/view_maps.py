"""All that the integration of one view needs: clothed normals of both sides, and the body's depth.

Maps are (H, W, ...) on the pixel grid of the view's own full perspective camera; normals are in the
map frame, x right, y up, z towards the viewer, so that z is negative on the back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.protocols import EstimatedNormals, NormalEstimator
from harness.geometry.images import resampled
from harness.geometry.photo import Picture, open_photo
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window

#: Share of the square that the subject's longer side fills, as in ECON's crops.
_FILLED = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class WorkingView:
    """One view, cropped and resampled; everything in it is on the pixel grid of ``camera``.

    Attributes:
        index: In the capture.
        camera: The capture's full perspective camera, for this window and size.
        rgb: (H, W, 3) sRGB in [0, 1], black outside the subject.
        mask: (H, W) where at least half of the pixel is subject.
        asked: The same square at the size that the estimator asks for; None where it takes any.
    """

    index: int
    camera: Camera
    rgb: Floats
    mask: Mask
    asked: WorkingView | None = None


def working_view(capture: Capture, index: int, resolution: int, asked_px: int = 0) -> WorkingView:
    """A view of a capture as a square of ``resolution`` pixels around its subject.

    The square may reach outside the picture, where nothing is. A picture is never enlarged, but for
    an estimator that asks for a size.

    Args:
        capture: The photos.
        index: Of the view.
        resolution: Greatest side of the square, pixels.
        asked_px: Side that the estimator asks for; 0 for any.

    Raises:
        MethodError: the view shows no subject.
    """
    photo = open_photo(capture, index)
    if not photo.mask.any():
        raise MethodError(
            f"view {index} of {capture.subject} shows no subject",
            expected="a mask that is not empty",
            got=str(photo.source),
        )
    window = Window.around(photo.mask).square(_FILLED)
    square, side = photo.cropped(window), min(resolution, window.width)
    view = _view(index, square.resized(side, side))
    if asked_px in (0, side):
        return view
    return replace(view, asked=_view(index, square.resized(asked_px, asked_px)))


def _view(index: int, picture: Picture) -> WorkingView:
    mask = picture.mask
    return WorkingView(index, picture.camera, picture.rgb * mask[..., None], mask)


@dataclass(frozen=True, slots=True, eq=False)
class ViewMaps:
    """The maps of one view.

    Attributes:
        view: The working picture.
        front, back: (H, W, 3) clothed unit normals inside the mask, 0 outside.
        body_front, body_back: (H, W, 3) unit normals of the body, 0 where there is none.
        body_near_m, body_far_m: (H, W) depth of the body's two sides, NaN where there is none.
        front_error_deg: (H, W) by how much ``front`` is expected to be off inside the mask; None
            from an estimator that does not say.
    """

    view: WorkingView
    front: Floats
    back: Floats
    body_front: Floats
    body_back: Floats
    body_near_m: Floats
    body_far_m: Floats
    front_error_deg: Floats | None = None

    def held_to(self, shape: Raycaster) -> ViewMaps:
        """The same normals with the depth of another body, such as one in its clothes."""
        near, far = (shape.cast(self.view.camera, side).depth for side in ("near", "far"))
        return replace(self, body_near_m=near, body_far_m=far)


def view_maps(view: WorkingView, body: Raycaster, estimator: NormalEstimator) -> ViewMaps:
    """The clothed normals that an estimator makes of a view, and the body behind them.

    Raises:
        MethodError: the estimator's maps have another size, or are not finite, or body and subject
            do not overlap.
    """
    near, far = body.cast(view.camera, "near"), body.cast(view.camera, "far")
    if not (near.mask & view.mask).any():
        raise MethodError(
            f"the fitted body is not where view {view.index} shows the subject",
            expected="an overlap of body and mask",
            got="none",
            hint="Look at the fitted body over the photo",
        )
    body_front = body.normals_at(near, view.camera)
    body_back = body.normals_at(far, view.camera)
    if view.asked is None:
        found = _estimated(view, body_front, body_back, estimator)
    else:
        front, back = (body.normals(view.asked.camera, side) for side in ("near", "far"))
        found = _reduced(_estimated(view.asked, front, back, estimator), view.asked, view)
    return ViewMaps(
        view=view,
        front=filled_normals(found.front, view.mask),
        back=filled_normals(found.back, view.mask),
        body_front=body_front,
        body_back=body_back,
        body_near_m=near.depth,
        body_far_m=far.depth,
        front_error_deg=found.front_error_deg,
    )


def _estimated(
    view: WorkingView, body_front: Floats, body_back: Floats, estimator: NormalEstimator
) -> EstimatedNormals:
    """An estimator's answer, checked."""
    found = estimator(view.rgb, view.mask.astype(np.float64), body_front, body_back)
    for name, normals in (("front", found.front), ("back", found.back)):
        if normals.shape != (*view.mask.shape, 3) or not np.isfinite(normals).all():
            raise MethodError(
                f"the estimator's {name} normals of view {view.index} cannot be used",
                expected=f"finite numbers of shape {(*view.mask.shape, 3)}",
                got=f"shape {normals.shape}, finite {bool(np.isfinite(normals).all())}",
            )
    return found


def _reduced(found: EstimatedNormals, asked: WorkingView, view: WorkingView) -> EstimatedNormals:
    """Maps of the size that an estimator asked for on the pixels of a view."""
    size = (view.camera.width, view.camera.height)

    def error(degrees: Floats | None) -> Floats | None:
        if degrees is None:
            return None
        inside = asked.mask.astype(np.float64)
        share = np.maximum(resampled(inside, size, "bilinear"), 1e-6)
        return np.where(view.mask, resampled(degrees * inside, size, "bilinear") / share, 0.0)

    return EstimatedNormals(
        resampled(found.front, size, "bilinear"),
        resampled(found.back, size, "bilinear"),
        error(found.front_error_deg),
        error(found.back_error_deg),
    )


def filled_normals(normals: Floats, mask: NDArray[np.bool_]) -> Floats:
    """(H, W, 3) unit normals at every pixel of the mask (H, W), 0 outside.

    A pixel of the mask without a normal, as beyond the body or on the last half pixel of the
    outline, takes that of the nearest pixel that has one.

    Raises:
        MethodError: no pixel of the mask has a normal.
    """
    from scipy.ndimage import distance_transform_edt

    length = np.linalg.norm(normals, axis=2)
    known = mask & (length > 1e-6)
    if not known.any():
        raise MethodError("no pixel of the mask has a normal", got=f"{int(mask.sum())} pixels")
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    rows, columns = (axis[mask] for axis in nearest)  # type: ignore[union-attr]
    filled = np.zeros_like(normals)
    filled[mask] = normals[rows, columns] / length[rows, columns, None]
    return filled
