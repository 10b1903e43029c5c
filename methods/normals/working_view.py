"""The picture that normals are estimated in: a square around the subject, at a working size."""

from __future__ import annotations

from dataclasses import dataclass, replace

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import Capture
from harness.core.cameras.camera import Camera
from harness.core.errors import MethodError
from harness.geometry.photo import Picture, open_photo
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
