"""The cube that IF-Nets+ works in: the person, seen without perspective, fills 0.9 of its side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from harness.core.cameras.frames import OPENCV_TO_BLENDER_CAMERA
from harness.core.mesh import Mesh

#: Longer side of the person's box, seen from the camera, in units of the cube, whose side is 2.
_PERSON = 1.8


@dataclass(frozen=True, slots=True, eq=False)
class Cube:
    """Where the cube is: x right, y up, z towards the viewer, each from -1 to 1.

    Attributes:
        from_world: (4, 4) similarity from world metres.
        to_world: (4, 4) its inverse.
    """

    from_world: Floats
    to_world: Floats


def cube_around(camera: Camera, seen: Mesh, body: Mesh) -> Cube:
    """The cube around a person.

    Args:
        camera: Its axes become the cube's; its perspective plays no part.
        seen: The sheets, world metres; the box of what the camera sees is centred across the view.
        body: The body, world metres; its box is centred along the view.
    """
    turn = OPENCV_TO_BLENDER_CAMERA[:3, :3] @ camera.rotation
    (left, low, _), (right, high, _) = _box(seen.vertices @ turn.T)
    (_, _, far), (_, _, near) = _box(body.vertices @ turn.T)
    scale = _PERSON / max(right - left, high - low)
    middle = np.array([left + right, low + high, far + near]) / 2.0
    from_world = np.eye(4)
    from_world[:3, :3], from_world[:3, 3] = scale * turn, -scale * middle
    return Cube(from_world, np.linalg.inv(from_world))


def _box(points: Floats) -> tuple[Floats, Floats]:
    return points.min(axis=0), points.max(axis=0)
