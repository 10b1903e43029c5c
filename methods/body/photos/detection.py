"""Two- and three-dimensional body landmarks in photos, by MediaPipe.

Source: MediaPipe Holistic 0.10.21 (Apache-2.0; the models are inside its wheel). Each view is
detected by itself, as a still picture, six times: as it is, darker, and on dark ground, each also
in the mirror. The detector does not treat them alike, so their mean is nearer to the truth and
their spread tells where it guesses. On 34 training avatars main landmarks that eight views agree on
scatter by 16.8 mm with one reading, 15.1 with two (the mirror), 14.5 with six; twelve, with turned
pictures and other margins, give 14.3.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Bytes, Floats, Mask
from harness.core.artifacts import Capture
from harness.core.files.hashing import file_sha256
from harness.core.process.shared_work import Sharing, Work, alone
from harness.core.process.threads import give_freed_memory_back
from harness.core.protocols import Part
from harness.geometry.images import PictureFile, composite, load_rgba
from harness.geometry.window import Window
from methods.body.models.anatomy import LEAN_DEG
from methods.parts.mediapipe_solutions import solutions, titled

#: Landmarks of MediaPipe's body.
COUNT = 33
#: The same landmark on the other side: a left/right swap is ``values[..., MIRRORED, :]``.
MIRRORED = np.array(
    [0, 4, 5, 6, 1, 2, 3, 8, 7, 10, 9]
    + [index + (1 if index % 2 else -1) for index in range(11, 33)]
)
#: The pictures that the detector is shown: the grey behind the subject, and the powers that the
#: brightness of such a picture is raised to.
_SHOWN = ((0.75, (1.0, 2.0)), (0.25, (1.0,)))
#: Free space around the subject, as a share of its height; the detector wants some.
_MARGIN = 0.12
#: A landmark that two readings place this far apart, in the person's longer side, counts half (more
#: readings: with the spread of two so far apart). On training avatars 95 of 100 are closer than
#: 0.03, and beyond it knees are guessed under skirts.
_HALF_TRUST = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """What was found in N views.

    Attributes:
        pixels: (N, 33, 2) in pixels of the full images.
        points_camera: (N, 33, 3) metres, relative to the middle of the hips; OpenCV camera axes;
            the detector's systematic lean is taken off.
        confidence: (N, 33) from 0 to 1, less where readings of one picture disagree; 0 for all
            where nothing was found.
        hands: (N, 2) share of the readings in which the left and the right hand was found.
    """

    pixels: Floats
    points_camera: Floats
    confidence: Floats
    hands: Floats

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
            hands=np.where(swapped, self.hands[:, ::-1], self.hands),
        )

    def at(self, views: Sequence[int] | NDArray[np.integer[Any]]) -> Detections:
        """The detections of some views, in that order."""
        index = np.asarray(views, dtype=np.int64)
        return Detections(
            self.pixels[index],
            self.points_camera[index],
            self.confidence[index],
            self.hands[index],
        )


def part() -> Part:
    """The detector as records name it."""
    return Part("landmarks", titled("Holistic"), "Apache-2.0")


def detect(capture: Capture, views: Sequence[int], share: Sharing = alone) -> Detections:
    """Landmarks in some views of a capture; a view without a person has confidence 0.

    No other view's photo is opened.

    Args:
        capture: The photos.
        views: Which of them.
        share: Reads each photo, or hands out what was read before.

    Raises:
        MissingPart: MediaPipe is not installed.
        DataError: an image cannot be read.
    """
    try:
        found = [
            share(_reading_of(capture.image_path(view), capture.cameras[view].size))
            for view in views
        ]
    finally:
        _forget_detector()
    return _together(found)


def detect_in(pictures: Sequence[Bytes]) -> Detections:
    """Landmarks in pictures (H, W, 4) that are no files; as of ``detect``.

    Raises:
        MissingPart: MediaPipe is not installed.
    """
    try:
        return _together([_read(picture) for picture in pictures])
    finally:
        _forget_detector()


def _together(found: Sequence[Reading]) -> Detections:
    return Detections(
        pixels=np.array([reading.pixels for reading in found]),
        points_camera=np.array([reading.points_camera for reading in found]) @ _upright().T,
        confidence=np.array([reading.confidence for reading in found]),
        hands=np.array([reading.hands for reading in found]),
    )


def _reading_of(path: Path, size: tuple[int, int]) -> Work[Reading]:
    return Work(
        name="landmarks",
        module=__name__,
        inputs={"photo": file_sha256(path), "size": list(size)},
        make=lambda: _detect(PictureFile.of(path), size),
        packed=lambda reading: reading._asdict(),
        unpacked=lambda arrays: Reading(*(arrays[name] for name in Reading._fields)),
    )


@functools.lru_cache(maxsize=64)
def _detect(file: PictureFile, size: tuple[int, int]) -> Reading:
    """Cached, because the method and the scorer of one cell ask the same."""
    return _read(load_rgba(file.path, size))


def _read(rgba: Bytes) -> Reading:
    window = _window(rgba[..., 3] >= 128)
    found = combined(list(_readings(_detector(), window.cut(rgba))))
    if found is None:
        return Reading(np.zeros((COUNT, 2)), np.zeros((COUNT, 3)), np.zeros(COUNT), np.zeros(2))
    return found._replace(pixels=found.pixels + np.array([window.left, window.top]))


class Reading(NamedTuple):
    """What the detector says of one picture.

    Attributes:
        pixels: (33, 2) in pixels of the picture.
        points_camera: (33, 3) metres about the middle of the hips, camera axes.
        confidence: (33,) from 0 to 1.
        hands: (2,) 1 where the left and the right hand was found, else 0; a share in a mean.
    """

    pixels: Floats
    points_camera: Floats
    confidence: Floats
    hands: Floats

    def reflected(self, width: int) -> Reading:
        """The same person in the mirror image of a picture that is so many pixels wide."""
        return Reading(
            pixels=(self.pixels * (-1.0, 1.0) + (width, 0.0))[MIRRORED],
            points_camera=(self.points_camera * (-1.0, 1.0, 1.0))[MIRRORED],
            confidence=self.confidence[MIRRORED],
            hands=self.hands[::-1],
        )


def combined(readings: Sequence[Reading]) -> Reading | None:
    """The mean of the readings of one picture, trusted less where they differ.

    None without a reading.
    """
    if not readings:
        return None
    pixels, points, confidence, hands = (np.array(values) for values in zip(*readings, strict=True))
    middle = pixels.mean(axis=0)
    spread = np.sqrt(((pixels - middle) ** 2).sum(axis=2).mean(axis=0))
    size = np.ptp(middle, axis=0).max()
    # Two readings are twice as far from each other as from their mean.
    trust = 1.0 / (1.0 + (2.0 * spread / (_HALF_TRUST * size)) ** 2)
    return Reading(middle, points.mean(axis=0), trust * confidence.mean(axis=0), hands.mean(axis=0))


def _readings(detector: Any, cut_out: NDArray[np.uint8]) -> Iterator[Reading]:
    """What the detector says of a subject, in every way that it is shown."""
    for picture in _pictures(cut_out):
        if (reading := _reading(detector, picture)) is not None:
            yield reading
        if (reading := _reading(detector, picture[:, ::-1])) is not None:
            yield reading.reflected(picture.shape[1])


def _pictures(cut_out: NDArray[np.uint8]) -> Iterator[NDArray[np.uint8]]:
    """Only the subject's rim is blended; elsewhere each level of colour has its own new one."""
    alpha = cut_out[..., 3]
    rim = np.nonzero((alpha > 0) & (alpha < 255))
    # The level after the last stands for the ground.
    level = np.where(alpha[..., None] == 0, 256, cut_out[..., :3]).astype(np.intp)
    for grey, powers in _SHOWN:
        light = np.append(np.arange(256) / 255.0, grey)
        blended = composite(cut_out[rim], (grey, grey, grey))
        for power in powers:
            picture = _levels(light**power)[level]
            picture[rim] = _levels(blended**power)
            yield picture


def _levels(light: Floats) -> NDArray[np.uint8]:
    return np.round(255 * light).astype(np.uint8)


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
        hands=np.array(
            [found.left_hand_landmarks is not None, found.right_hand_landmarks is not None], float
        ),
    )


def _upright() -> Floats:
    """The rotation about the camera's x axis that takes the detector's lean off."""
    cosine, sine = np.cos(np.radians(LEAN_DEG)), np.sin(np.radians(LEAN_DEG))
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


@functools.lru_cache(maxsize=1)
def _detector() -> Any:
    """The detector, loaded once; in still-picture mode it remembers nothing of earlier pictures."""
    holistic = solutions("finding landmarks").holistic.Holistic
    return holistic(static_image_mode=True, model_complexity=1)


def _forget_detector() -> None:
    """It holds 180 MiB, which a method can use for the rest of its time."""
    if _detector.cache_info().currsize:
        _detector().close()
        _detector.cache_clear()
        give_freed_memory_back()


def _window(mask: Mask) -> Window:
    """The window around the subject (H, W) that the detector is shown; all of a photo without."""
    height, width = mask.shape
    box = Window.around(mask) if mask.any() else Window.whole((width, height))
    return box.grown(round(_MARGIN * box.height))
