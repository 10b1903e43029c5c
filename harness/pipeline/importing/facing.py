"""Where a person faces, and whether they stand on their feet, from landmarks in photos."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Capture
from methods.body.photos.detection import Detections, detect

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
