"""Where up, front and the origin are in a camera file's world, and how long its unit is."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.errors import HarnessError
from harness.geometry.similarity import Similarity
from methods.body.photos.detection import Detections, detect

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_AXIS = re.compile(r"([+-]?)([xyz])")
#: Horizontal axes of cameras that differ less than this in direction do not span a plane: the ratio
#: of the second to the first principal value.
_LEAST_SPREAD = 0.05


def unit(vector: Floats) -> Floats:
    """(3,) the vector at length 1."""
    return vector / np.linalg.norm(vector)


def parsed_axis(text: str) -> Floats | None:
    """(3,) the unit vector behind ``+z``, ``-y`` or ``0,0.1,-1``; None for other texts.

    Raises:
        HarnessError: three numbers that are no direction.
    """
    if match := _AXIS.fullmatch(text.strip().lower()):
        return np.array(_AXES[match[2]]) * (-1.0 if match[1] == "-" else 1.0)
    words = text.split(",")
    try:
        vector = np.array([float(word) for word in words])
    except ValueError:
        return None
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise HarnessError(f"'{text}' is no direction", expected="such as +z, -y or 0,0,1")
    return unit(vector)


def up_of_cameras(cameras: Sequence[Camera]) -> Floats:
    """(3,) up, as cameras that are held level tell it: their horizontal axes lie in the ground.

    Where all look in nearly one direction, it is the mean of what is up in their pictures.
    """
    upward = np.mean([-camera.rotation[1] for camera in cameras], axis=0)
    sideways = np.array([camera.rotation[0] for camera in cameras])
    _, spread, axes = np.linalg.svd(sideways, full_matrices=True)
    if len(spread) > 1 and spread[1] > _LEAST_SPREAD * spread[0]:
        up = axes[2]
        return up if up @ upward >= 0 else -up
    return unit(upward)


def quarters_upright(camera: Camera, up: Floats) -> int:
    """By how many quarter turns against the clock a picture is turned until up is up in it."""
    x, y, _ = camera.rotation @ up
    # Up points to the right of the picture: one turn against the clock brings it to the top.
    return round(float(np.degrees(np.arctan2(x, -y))) / 90.0) % 4


def upright(up: Floats, forward: Floats | None = None) -> Similarity:
    """The turn from a file's axes to ours: +Y up, the person facing +Z.

    Without a front, some direction across up is taken for it.
    """
    front = np.eye(3)[int(np.argmin(np.abs(up)))] if forward is None else forward
    level = front - up * float(front @ up)
    if np.linalg.norm(level) < 1e-6:
        raise HarnessError("the front cannot be up", hint="Give --facing a direction across --up")
    front = unit(level)
    return Similarity(1.0, np.stack([np.cross(up, front), up, front]), np.zeros(3))


#: Landmarks of MediaPipe's body: pairs of left and right at shoulders and hips; the head's.
_LEFT, _RIGHT, _HEAD = [11, 23], [12, 24], [0, 7, 8]
#: So many photos are enough to tell.
_MOST_ASKED = 12
_CONFIDENT = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """What landmarks tell of a person.

    Attributes:
        forward: (3,) unit direction across up that the person faces, in the cameras' world.
        agreement: How well the photos agree on it, 0 to 1.
        upright: Whether the head is above the hips.
        found: In how many photos a person was found.
        asked: In how many one was looked for.
    """

    forward: Floats
    agreement: float
    upright: bool
    found: int
    asked: int


def stance_of(capture: Capture, up: Floats) -> Stance | None:
    """How the person in a capture stands; None where no photo shows one.

    Args:
        capture: Its photos, upright.
        up: (3,) up in the world of its cameras.

    Raises:
        MissingPart: MediaPipe is not installed.
    """
    count = len(capture.cameras)
    asked = np.unique(np.linspace(0, count - 1, min(count, _MOST_ASKED)).round().astype(int))
    found = detect(capture, [int(view) for view in asked])
    trust = found.confidence[:, [*_LEFT, *_RIGHT]].min(axis=1)
    used = np.flatnonzero(trust > _CONFIDENT)
    if not len(used):
        used = np.flatnonzero(found.found)
    if not len(used):
        return None
    turns = np.array([capture.cameras[int(asked[view])].rotation.T for view in used])
    sideways, upward = _axes(found.at(used))
    left = np.einsum("nij,nj->ni", turns, sideways)
    fronts = np.cross(left, up) * trust[used, None]
    total = fronts.sum(axis=0)
    agreement = float(np.linalg.norm(total) / max(np.linalg.norm(fronts, axis=1).sum(), 1e-9))
    head = np.einsum("nij,nj->ni", turns, upward) @ up
    if np.linalg.norm(total) < 1e-9:
        return None
    return Stance(
        forward=total / np.linalg.norm(total),
        agreement=agreement,
        upright=bool((head * trust[used]).sum() >= 0),
        found=len(used),
        asked=len(asked),
    )


def _axes(found: Detections) -> tuple[Floats, Floats]:
    """(N, 3) unit directions from right to left, and from hips to head, in camera axes."""
    points = found.points_camera
    sideways = points[:, _LEFT].mean(axis=1) - points[:, _RIGHT].mean(axis=1)
    upward = points[:, _HEAD].mean(axis=1) - points[:, [23, 24]].mean(axis=1)
    length = np.linalg.norm(sideways, axis=1, keepdims=True)
    rise = np.linalg.norm(upward, axis=1, keepdims=True)
    return sideways / np.maximum(length, 1e-9), upward / np.maximum(rise, 1e-9)
