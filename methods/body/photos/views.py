"""A view as the fit sees it: its mask at a working size, its landmarks, its frame of reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.cameras.camera import Camera
from harness.core.errors import MethodError
from harness.geometry.images import load_mask, resampled
from harness.geometry.place import Place, mask_box, place_of
from methods.body.photos.detection import Detections, detect

__all__ = ["FRAME_MARGIN", "View", "Views", "frame_side_px", "load_views"]


#: Side of the square that losses refer to, in longer sides of the subject's box, about as in ECON's
#: crops; without it a loss would depend on how much of the picture the subject fills.
FRAME_MARGIN = 1.1
#: Fewer confident landmarks than this are no person.
_LEAST_LANDMARKS = 6
_CONFIDENT = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One usable view at its working size.

    Attributes:
        index: In the capture.
        camera: Of the working picture.
        coverage: (H, W) of the subject, 0 to 1.
        side_px: Side of the subject's frame in working pixels.
        place: Where the subject stands, the same for all views that are fitted together.
        normals_camera: (H, W, 3) clothed normals in the map frame, or None.
    """

    index: int
    camera: Camera
    coverage: Floats
    side_px: float
    place: Place
    normals_camera: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """The usable views and what was found in them.

    Attributes:
        views: In the order of the capture.
        detections: Of these views; ``pixels`` are working pixels.
        left_out: Reason by view index.
    """

    views: tuple[View, ...]
    detections: Detections
    left_out: dict[int, str]

    @property
    def indices(self) -> tuple[int, ...]:
        """Indices of the views in the capture."""
        return tuple(view.index for view in self.views)


def frame_side_px(inside: NDArray[np.bool_]) -> float:
    """Side of the square that losses refer to: a little more than the subject's box, pixels."""
    left, top, right, bottom = mask_box(inside)
    return FRAME_MARGIN * max(bottom - top, right - left)


def load_views(
    capture: Capture,
    indices: Sequence[int],
    subject_px: int,
    normals: Callable[[Camera], Floats] | None = None,
    centre: Floats | None = None,
) -> Views:
    """The usable ones among some views of a capture.

    Args:
        capture: The photos.
        indices: Which of its views.
        subject_px: Longer side of the subject in working pixels; pictures are never enlarged.
        normals: Makes the clothed normals (H, W, 3) of a camera, map frame.
        centre: (3,) the middle of the subject's box, world metres, where that is given away;
            otherwise the photos tell where the subject stands.

    Raises:
        MethodError: no view shows a person.
        MissingPart: MediaPipe is not installed.
    """
    found = detect(capture, indices)
    coverages: dict[int, Floats] = {}
    left_out: dict[int, str] = {}
    for index, confidence in zip(indices, found.confidence, strict=True):
        if int((confidence > _CONFIDENT).sum()) < _LEAST_LANDMARKS:
            left_out[index] = "no person was detected"
            continue
        coverage = load_mask(capture.image_path(index), capture.cameras[index].size)
        if (coverage > 0.5).any():
            coverages[index] = coverage
        else:
            left_out[index] = "its mask is empty"
    if not coverages:
        raise MethodError(
            "no view shows a person",
            expected="at least one view with a detected person and a mask",
            got="; ".join(f"view {index}: {why}" for index, why in left_out.items()),
        )
    place = _place(capture, coverages, centre)
    views = [
        _working_view(index, capture.cameras[index], coverage, subject_px, place)
        for index, coverage in coverages.items()
    ]
    if normals is not None:
        views = [replace(view, normals_camera=normals(view.camera)) for view in views]
    detections = found.at([list(indices).index(index) for index in coverages])
    scales = [
        [view.camera.width / capture.cameras[view.index].width,
         view.camera.height / capture.cameras[view.index].height]
        for view in views
    ]  # fmt: skip
    working = replace(detections, pixels=detections.pixels * np.array(scales)[:, None])
    return Views(tuple(views), working, left_out)


def _place(capture: Capture, coverages: Mapping[int, Floats], centre: Floats | None) -> Place:
    cameras = [capture.cameras[index] for index in coverages]
    place = place_of(cameras, [coverage > 0.5 for coverage in coverages.values()])
    return place if centre is None else replace(place, centre=centre, depth_is_known=True)


def _working_view(
    index: int, camera: Camera, coverage: Floats, subject_px: int, place: Place
) -> View:
    side = frame_side_px(coverage > 0.5)
    scale = min(1.0, subject_px * FRAME_MARGIN / side)
    width, height = (max(1, round(scale * size)) for size in camera.size)
    working = camera.resized(width, height)
    return View(
        index=index,
        camera=working,
        coverage=resampled(coverage, (width, height), "box"),
        side_px=side * width / camera.width,
        place=place,
    )
