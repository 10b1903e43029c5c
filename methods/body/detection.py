"""Two- and three-dimensional body landmarks in photos, by MediaPipe.

Source: MediaPipe Holistic 0.10.21 (Apache-2.0; the models are inside its wheel). Each view is
detected by itself, as a still picture, and a second time in its mirror image: the detector does not
treat the two alike, so their mean is nearer to the truth and their difference tells where it
guesses. On 18 training avatars the error of the points that eight views agree on falls by 13 %.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Capture
from harness.core.errors import MissingPart
from harness.core.protocols import Part
from harness.geometry.images import composite, load_rgba
from methods.body.offsets import LEAN_DEG

__all__ = ["COUNT", "MIRRORED", "Detections", "Reading", "agreed", "detect", "part"]

Floats = NDArray[np.float64]

#: Landmarks of MediaPipe's body.
COUNT = 33
#: The same landmark on the other side: a left/right swap is ``values[..., MIRRORED, :]``.
MIRRORED = np.array(
    [0, 4, 5, 6, 1, 2, 3, 8, 7, 10, 9]
    + [index + (1 if index % 2 else -1) for index in range(11, 33)]
)
_BACKGROUND = (0.75, 0.75, 0.75)
#: Free space around the subject, as a share of its height; the detector wants some.
_MARGIN = 0.12
#: A landmark that two readings place this far apart, in the person's longer side, counts half: on
#: training avatars 95 of 100 are closer than 0.03, and beyond it knees are guessed under skirts.
_HALF_TRUST = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """What was found in N views.

    Attributes:
        pixels: (N, 33, 2) in pixels of the full images.
        points_camera: (N, 33, 3) metres, relative to the middle of the hips; OpenCV camera axes;
            the detector's systematic lean is taken off.
        confidence: (N, 33) from 0 to 1, less where a picture and its mirror image disagree; 0 for
            all where nothing was found.
    """

    pixels: Floats
    points_camera: Floats
    confidence: Floats

    @property
    def found(self) -> NDArray[np.bool_]:
        """(N,) whether a person was found."""
        return self.confidence.any(axis=1)

    def mirrored(self, views: NDArray[np.bool_]) -> Detections:
        """The same with left and right exchanged in some views (N,)."""
        swapped = views[:, None]
        return Detections(
            pixels=np.where(swapped[..., None], self.pixels[:, MIRRORED], self.pixels),
            points_camera=np.where(
                swapped[..., None], self.points_camera[:, MIRRORED], self.points_camera
            ),
            confidence=np.where(swapped, self.confidence[:, MIRRORED], self.confidence),
        )

    def at(self, views: Sequence[int] | NDArray[np.integer[Any]]) -> Detections:
        """The detections of some views, in that order."""
        index = np.asarray(views, dtype=np.int64)
        return Detections(self.pixels[index], self.points_camera[index], self.confidence[index])


def part() -> Part:
    """The detector as records name it."""
    try:
        return Part("landmarks", f"MediaPipe Holistic {version('mediapipe')}", "Apache-2.0")
    except PackageNotFoundError:
        return Part("landmarks", "MediaPipe Holistic", "Apache-2.0")


def detect(capture: Capture) -> Detections:
    """Landmarks in every view of a capture; a view without a person has confidence 0.

    Raises:
        MissingPart: MediaPipe is not installed.
        DataError: an image cannot be read.
    """
    images = tuple(capture.image_path(view) for view in range(len(capture.cameras)))
    return _detect(images, tuple(camera.size for camera in capture.cameras), capture.key)


@functools.lru_cache(maxsize=2)
def _detect(
    images: tuple[Path, ...],
    sizes: tuple[tuple[int, int], ...],
    key: str,  # noqa: ARG001 - the cache's
) -> Detections:
    """Cached, because the method and the scorer of one cell ask the same."""
    holistic = _holistic()
    pixels = np.zeros((len(images), COUNT, 2))
    points = np.zeros((len(images), COUNT, 3))
    confidence = np.zeros((len(images), COUNT))
    with holistic(static_image_mode=True, model_complexity=1) as detector:
        for view, (path, size) in enumerate(zip(images, sizes, strict=True)):
            left, top, picture = _cut_out(load_rgba(path, size))
            reflected = _reading(detector, picture[:, ::-1])
            found = agreed(
                _reading(detector, picture),
                None if reflected is None else reflected.reflected(picture.shape[1]),
            )
            if found is None:
                continue
            pixels[view] = found.pixels + np.array([left, top])
            points[view], confidence[view] = found.points_camera, found.confidence
    return Detections(pixels, points @ _upright().T, confidence)


class Reading(NamedTuple):
    """What the detector says of one picture.

    Attributes:
        pixels: (33, 2) in pixels of the picture.
        points_camera: (33, 3) metres about the middle of the hips, camera axes.
        confidence: (33,) from 0 to 1.
    """

    pixels: Floats
    points_camera: Floats
    confidence: Floats

    def reflected(self, width: int) -> Reading:
        """The same person in the mirror image of a picture that is so many pixels wide."""
        return Reading(
            pixels=(self.pixels * (-1.0, 1.0) + (width, 0.0))[MIRRORED],
            points_camera=(self.points_camera * (-1.0, 1.0, 1.0))[MIRRORED],
            confidence=self.confidence[MIRRORED],
        )


def agreed(one: Reading | None, other: Reading | None) -> Reading | None:
    """What two readings of one picture say together, or the only one that sees a person."""
    if one is None or other is None:
        return one or other
    apart = np.linalg.norm(one.pixels - other.pixels, axis=1)
    size = np.ptp(one.pixels, axis=0).max()
    trust = 1.0 / (1.0 + (apart / (_HALF_TRUST * size)) ** 2)
    return Reading(
        pixels=(one.pixels + other.pixels) / 2,
        points_camera=(one.points_camera + other.points_camera) / 2,
        confidence=trust * (one.confidence + other.confidence) / 2,
    )


def _reading(detector: Any, picture: NDArray[np.uint8]) -> Reading | None:
    found = detector.process(np.ascontiguousarray(picture))
    if found.pose_landmarks is None or found.pose_world_landmarks is None:
        return None
    height, width, _ = picture.shape
    marks = found.pose_landmarks.landmark
    return Reading(
        pixels=np.array([(mark.x * width, mark.y * height) for mark in marks]),
        points_camera=np.array([(m.x, m.y, m.z) for m in found.pose_world_landmarks.landmark]),
        confidence=np.clip([mark.visibility for mark in marks], 0.0, 1.0),
    )


def _upright() -> Floats:
    """The rotation about the camera's x axis that takes the detector's lean off."""
    cosine, sine = np.cos(np.radians(LEAN_DEG)), np.sin(np.radians(LEAN_DEG))
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


def _holistic() -> Any:
    try:
        import mediapipe
    except ImportError as error:
        raise MissingPart(
            "landmarks are found with MediaPipe, which is not installed",
            hint="Run: pip install mediapipe==0.10.21",
        ) from error
    return mediapipe.solutions.holistic.Holistic


def _cut_out(rgba: NDArray[np.uint8]) -> tuple[int, int, NDArray[np.uint8]]:
    """Column and row of a window round the subject, and its picture on plain grey."""
    rows, columns = (np.flatnonzero((rgba[..., 3] > 127).any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        rows, columns = np.arange(rgba.shape[0]), np.arange(rgba.shape[1])
    margin = round(_MARGIN * (rows[-1] - rows[0] + 1))
    top, bottom = rows[0] - margin, rows[-1] + 1 + margin
    left, right = columns[0] - margin, columns[-1] + 1 + margin
    canvas = np.zeros((bottom - top, right - left, 4), dtype=np.uint8)
    inner_top, inner_left = max(top, 0), max(left, 0)
    piece = rgba[inner_top : max(bottom, 0), inner_left : max(right, 0)]
    height, width, _ = piece.shape
    canvas[inner_top - top :, inner_left - left :][:height, :width] = piece
    picture = np.round(composite(canvas, _BACKGROUND) * 255).astype(np.uint8)
    return int(left), int(top), np.ascontiguousarray(picture)
