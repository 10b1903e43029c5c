"""Photos of a still person in, cameras out."""
# ruff: noqa: ARG001

from __future__ import annotations

from collections.abc import Sequence

from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.process.threads import StepReport, silent
from methods.body.photos.detection import Detections
from methods.cameras.values import EstimatedCameras, Focal, PhotoView


def estimate_cameras(
    photos: Sequence[PhotoView],
    *,
    focal: Focal,
    height_m: float,
    landmarks: Detections | None = None,
    seed: int = 0,
    report: StepReport = silent,
) -> EstimatedCameras:
    """The cameras of photos that were taken around a person who stands still.

    Args:
        photos: 5 to 64, upright, in any order; a neighbour of each within 65 degrees.
        focal: Their focal lengths.
        height_m: The person's height, with shoes and hair, metres.
        landmarks: Of the photos, in their order; None finds them with MediaPipe.
        seed: Of the search.
        report: Called after every step.

    Raises:
        MethodError: photos that no cameras can be trusted of; the sentence says what is wrong.
        MissingPart: MediaPipe is needed, and not installed.
    """
    raise MethodError("cameras cannot be estimated yet", got=f"{len(photos)} photos")


def refine_cameras(
    photos: Sequence[PhotoView],
    cameras: Sequence[Camera],
    *,
    seed: int = 0,
    report: StepReport = silent,
) -> EstimatedCameras:
    """Cameras that are a few pixels or degrees off, brought to what outlines and photos say.

    They stay in their world: its place, turn and scale are those of the cameras that were given.
    Cameras whose photos lie less than ``least_px`` off, or that gain nothing, stay as they are.

    Args:
        photos: In the cameras' order.
        cameras: With these photos' pixels; metres.
        seed: Of the search.
        report: Called after every step.

    Raises:
        MethodError: photos and cameras that contradict each other.
    """
    raise MethodError("cameras cannot be refined yet", got=f"{len(photos)} photos")
