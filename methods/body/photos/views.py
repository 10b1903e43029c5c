"""A view as the fit sees it: its mask at a working size, its landmarks, its frame of reference."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.process.shared_work import Sharing, alone
from harness.geometry.outline import Outline
from harness.geometry.photo import open_photo
from harness.geometry.place import Place, place_of
from harness.geometry.window import Window
from methods.body.photos.detection import Detections, detect

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
        camera: The working picture's camera.
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
        detections: What was found in these views; ``pixels`` are working pixels.
        left_out: Reason by view index.
    """

    views: tuple[View, ...]
    detections: Detections
    left_out: dict[int, str]

    @property
    def indices(self) -> tuple[int, ...]:
        """Indices of the views in the capture."""
        return tuple(view.index for view in self.views)


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What is known of a subject beyond its photos: privileges.

    Attributes:
        normals: Makes the clothed normals (H, W, 3) of a camera, map frame.
        centre: (3,) the middle of the subject's box, world metres; without it the photos tell where
            the subject stands.
    """

    normals: Callable[[Camera], Floats] | None = None
    centre: Floats | None = None


def frame_side_px(inside: Mask) -> float:
    """Side of the square that losses refer to: a little more than the subject's box, pixels."""
    return FRAME_MARGIN * Window.around(inside).longer_side


def load_views(
    capture: Capture,
    indices: Sequence[int],
    subject_px: int,
    given: Given | None = None,
    share: Sharing = alone,
) -> Views:
    """The usable ones among some views of a capture.

    Args:
        capture: The photos.
        indices: Which of its views.
        subject_px: Longer side of the subject in working pixels; pictures are never enlarged.
        given: What is known beyond photos; None is nothing.
        share: Finds the landmarks, or hands out those that were found before.

    Raises:
        MethodError: no view shows a person.
        MissingPart: MediaPipe is not installed.
    """
    given = given or Given()
    found = detect(capture, indices, share)
    outlines: dict[int, Outline] = {}
    left_out: dict[int, str] = {}
    for index, confidence in zip(indices, found.confidence, strict=True):
        if int((confidence > _CONFIDENT).sum()) < _LEAST_LANDMARKS:
            left_out[index] = "no person was detected"
            continue
        outline = open_photo(capture, index).outline
        if outline.is_empty:
            left_out[index] = "its mask is empty"
        else:
            outlines[index] = outline
    if not outlines:
        raise MethodError(
            "no view shows a person",
            expected="at least one view with a detected person and a mask",
            got="; ".join(f"view {index}: {why}" for index, why in left_out.items()),
        )
    place = place_of(list(outlines.values()))
    if given.centre is not None:
        place = replace(place, centre=given.centre, depth_is_known=True)
    views = [
        _working_view(index, outline, subject_px, place) for index, outline in outlines.items()
    ]
    if given.normals is not None:
        views = [replace(view, normals_camera=given.normals(view.camera)) for view in views]
    detections = found.at([list(indices).index(index) for index in outlines])
    scales = [
        [view.camera.width / capture.cameras[view.index].width,
         view.camera.height / capture.cameras[view.index].height]
        for view in views
    ]  # fmt: skip
    working = replace(detections, pixels=detections.pixels * np.array(scales)[:, None])
    return Views(tuple(views), working, left_out)


def _working_view(index: int, outline: Outline, subject_px: int, place: Place) -> View:
    side = frame_side_px(outline.mask)
    scale = min(1.0, subject_px * FRAME_MARGIN / side)
    width, height = (max(1, round(scale * size)) for size in outline.camera.size)
    working = outline.resized(width, height)
    return View(
        index=index,
        camera=working.camera,
        coverage=working.coverage,
        side_px=side * width / outline.camera.width,
        place=place,
    )
