"""Where a subject stands, as far as its silhouettes in calibrated photos tell.

Methods start from this place and not from the world's origin, so that their results move with the
cameras wherever the world's frame has been put.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.geometry.outline import Outline
from harness.geometry.window import Window

#: What a person's silhouette is taken to span where a single view tells no distance.
MEAN_HEIGHT_M = 1.70
#: Weights in the least-squares problem, against 1 for a metre off the ray through a box's middle:
#: a metre off the depth that a box's height suggests, and a metre off the mean height. The last
#: decides only where no two cameras do.
_SIZE_WEIGHT, _HEIGHT_WEIGHT = 0.1, 1e-3
#: Where nothing tells depth, a subject is put so far from the camera's origin, metres.
UNTOLD_DEPTH_M = 3.0
#: Cameras that are this far apart, in distances to the subject, tell where it stands; orthographic
#: ones whose axes cross at an angle with this sine.
_LEAST_BASELINE = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """The middle of a subject and how it is known.

    Attributes:
        centre: (3,) world metres.
        half_height_m, half_width_m: Half of what the silhouettes span there, the widest of all.
        depth_is_known: Whether cameras apart from each other, or a privilege, tell the distance;
            otherwise it follows from the mean height of people, or is ``UNTOLD_DEPTH_M``.
    """

    centre: Floats
    half_height_m: float
    half_width_m: float
    depth_is_known: bool

    def distance_m(self, camera: Camera) -> float:
        """How far the middle is from a camera along its optical axis, metres."""
        return float(camera.forward @ (self.centre - camera.position))


def no_depth_is_told(cameras: Sequence[Camera]) -> bool:
    """Whether photos of these cameras look the same wherever along their axes the subject stands.

    That is so of one orthographic camera, and of several whose axes are parallel.
    """
    axes = np.array([camera.forward for camera in cameras])
    crossed = np.linalg.norm(np.cross(axes[:, None], axes[None]), axis=2).max()
    return all(camera.is_orthographic for camera in cameras) and crossed < _LEAST_BASELINE


def place_of(outlines: Sequence[Outline]) -> Place:
    """The place of a subject from its silhouettes in one or more views.

    One linear least-squares problem: the middle lies on the ray through the middle of each box,
    at the depth at which the box is as high as the subject, whose height is an unknown that the
    views share. The box of an orthographic view is as high as the subject at any depth.

    Raises:
        MethodError: a silhouette is empty, or the subject would be behind a camera.
    """
    if any(outline.is_empty for outline in outlines):
        raise MethodError("a view shows no subject", expected="a mask that is not empty")
    cameras, boxes = [o.camera for o in outlines], [o.box for o in outlines]
    rows: list[Floats] = [np.array([0.0, 0.0, 0.0, _HEIGHT_WEIGHT])]
    values: list[float] = [_HEIGHT_WEIGHT * MEAN_HEIGHT_M]
    for camera, box in zip(cameras, boxes, strict=True):
        middle = np.array([[(box.left + box.right) / 2, (box.top + box.bottom) / 2]])
        ray = camera.ray_directions(middle)[0]
        ray = ray / np.linalg.norm(ray)
        across = np.eye(3) - np.outer(ray, ray)
        rows += [np.append(row, 0.0) for row in across]
        values += (across @ camera.ray_origins(middle)[0]).tolist()
        origin_m = float(camera.forward @ camera.position)
        if camera.is_orthographic:
            rows.append(_SIZE_WEIGHT * np.array([0.0, 0.0, 0.0, 1.0]))
            values.append(_SIZE_WEIGHT * box.height / camera.K[1, 1])
            rows.append(_HEIGHT_WEIGHT * np.append(camera.forward, 0.0))
            values.append(_HEIGHT_WEIGHT * (origin_m + UNTOLD_DEPTH_M))
            continue
        depth_per_height = camera.K[1, 1] / box.height
        rows.append(_SIZE_WEIGHT * np.append(camera.forward, -depth_per_height))
        values.append(_SIZE_WEIGHT * origin_m)
    solution = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]
    return _spanned(solution[:3], cameras, boxes)


def _spanned(centre: Floats, cameras: Sequence[Camera], boxes: Sequence[Window]) -> Place:
    """The place around a middle, with what the boxes span there."""
    depths = [float(camera.forward @ (centre - camera.position)) for camera in cameras]
    if min(depths) <= 0:
        raise MethodError(
            "the silhouettes do not show one subject in front of all cameras",
            expected="cameras that look at the subject",
            got=f"a middle {min(depths):.2f} m in front of a camera",
            hint="Check the cameras",
        )
    heights, widths = [], []
    for camera, box, depth in zip(cameras, boxes, depths, strict=True):
        widths.append(box.width / 2 * float(camera.spread(depth)) / camera.K[0, 0])
        heights.append(box.height / 2 * float(camera.spread(depth)) / camera.K[1, 1])
    positions = np.array([camera.eye_of(centre[None])[0] for camera in cameras])
    baseline = np.linalg.norm(positions[:, None] - positions[None], axis=2).max()
    known = bool(baseline > _LEAST_BASELINE * min(depths)) and not no_depth_is_told(cameras)
    return Place(centre, max(heights), max(widths), known)
