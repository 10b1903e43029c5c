"""What the fusion and the photo-consistency know of one photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.core.arrays import Floats, Singles
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.protocols import even_places
from harness.geometry.photo import open_photo
from methods.closed.surfaces import SignedOutline, signed_outline

#: Fewer silhouettes leave most of the hull's surface free.
LEAST_VIEWS = 3
#: More were not tried.
MOST_VIEWS = 64


@dataclass(frozen=True, slots=True, eq=False)
class NormalTargets:
    """The clothed normals of the near side that one view asks for.

    Attributes:
        camera: Camera of these pixels: the photo's own, or a crop of it at another size.
        normals_world: (H, W, 3) unit normals in the world frame, 0 outside the subject.
        weights: (H, W) how much each counts, 0 for nothing; None lets all count once.
    """

    camera: Camera
    normals_world: Singles
    weights: Singles | None = None

    def __post_init__(self) -> None:
        size = (self.camera.height, self.camera.width)
        if self.normals_world.shape != (*size, 3):
            raise MethodError(
                "a map of normals is not of its camera's size",
                expected=f"shape {(*size, 3)}",
                got=f"shape {self.normals_world.shape}",
            )
        if self.weights is not None and self.weights.shape != size:
            raise MethodError(
                "a map of weights is not of its camera's size",
                expected=f"shape {size}",
                got=f"shape {self.weights.shape}",
            )


@dataclass(frozen=True, slots=True, eq=False)
class FusionView:
    """One calibrated photo with its outline and its normals.

    Attributes:
        index: In the capture.
        camera: Camera of the whole photo.
        outline: The subject's outline, in pixels of the photo.
        targets: The normals that the surface should have where this view sees it; None for a view
            that gives its outline alone.
    """

    index: int
    camera: Camera
    outline: SignedOutline
    targets: NormalTargets | None = None

    def with_targets(self, targets: NormalTargets) -> FusionView:
        """The same view with other normals."""
        return replace(self, targets=targets)


def fusion_view(
    index: int,
    camera: Camera,
    coverage: Floats,
    targets: NormalTargets | None = None,
) -> FusionView:
    """A view from the photo's coverage (H, W), 0 to 1, and its normals.

    Raises:
        MethodError: coverage of another size than the camera's, or no subject in it.
    """
    try:
        outline = signed_outline(camera, coverage)
    except MethodError as error:
        raise error.located(f"view {index}") from error
    return FusionView(index, camera, outline, targets)


def outline_views(capture: Capture, indices: Sequence[int]) -> list[FusionView]:
    """Some views of a capture with their outlines alone.

    Raises:
        MethodError: a photo of another size than its camera's, or without the subject.
        DataError: a photo that cannot be read.
    """
    return [
        fusion_view(index, capture.cameras[index], open_photo(capture, index).coverage)
        for index in indices
    ]


def even_choice(capture: Capture, count: int) -> Capture:
    """The capture with so many of its views, the front and others as evenly apart as can be.

    Args:
        capture: Counted from the front.
        count: How many; 0 takes all.

    Raises:
        MethodError: the capture has fewer.
    """
    total = len(capture.cameras)
    if count > total:
        raise MethodError(
            f"{count} views were asked for",
            expected=f"at most the {total} of the photos",
            got=f"{count}",
            hint=f"Set nview.views to at most {total}, or 0 for all",
        )
    if count in (0, total):
        return capture
    chosen = even_places(count, total)
    numbers = capture.numbers or tuple(range(total))
    return replace(
        capture,
        cameras=tuple(capture.cameras[view] for view in chosen),
        numbers=tuple(numbers[view] for view in chosen),
    )


def checked_views(views: Sequence[FusionView]) -> tuple[FusionView, ...]:
    """The views, if a surface can be found from them.

    Raises:
        MethodError: fewer than 3 or more than 64 views, or cameras that stand in one place.
    """
    if not LEAST_VIEWS <= len(views) <= MOST_VIEWS:
        raise MethodError(
            "the surface cannot be fused from so many views",
            expected=f"{LEAST_VIEWS} to {MOST_VIEWS} views",
            got=f"{len(views)}",
            hint="Use a method that is made for one or two views, such as mexecon2",
        )
    positions = np.array([view.camera.position for view in views])
    if len(np.unique(np.round(positions, 3), axis=0)) < LEAST_VIEWS:
        raise MethodError(
            "the cameras do not look at the subject from enough places",
            expected=f"at least {LEAST_VIEWS} places",
            got=f"{len(np.unique(np.round(positions, 3), axis=0))}",
            hint="Check the poses of the cameras",
        )
    return tuple(views)
