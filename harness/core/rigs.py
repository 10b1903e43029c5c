"""Where cameras stand, and how photos are taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import ClassVar, Literal

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera, look_at
from harness.core.errors import DataError


def focal_length_px(lens_mm: float, sensor_mm: float, width: int, height: int) -> float:
    """Focal length in pixels of a lens whose sensor is fitted to the image's longer side."""
    return lens_mm / sensor_mm * max(width, height)


def camera_yaw_deg(camera: Camera) -> float:
    """The yaw of a camera's position, degrees in [0, 360): 0 at +Z, growing towards +X.

    It is rounded to a millionth of a degree, so that rounding noise does not reorder cameras.
    """
    x, _, z = camera.position
    return round(math.degrees(math.atan2(x, z)), 6) % 360


def views_from_front(cameras: Sequence[Camera], front_yaw_deg: float = 0.0) -> tuple[int, ...]:
    """The numbers of all views, the frontal one first, then by yaw towards the subject's left.

    The frontal view is the one nearest to the direction that the subject faces, by default +Z.
    Among eight evenly spaced views, the third is then the left side and the fifth is the back,
    whatever numbers the rig gives them.
    """
    yaws_deg = [round(camera_yaw_deg(camera) - front_yaw_deg, 6) % 360 for camera in cameras]
    front_deg = min(yaws_deg, key=lambda yaw_deg: min(yaw_deg, 360 - yaw_deg), default=0.0)
    return tuple(
        sorted(range(len(yaws_deg)), key=lambda view: round(yaws_deg[view] - front_deg, 6) % 360)
    )


@dataclass(frozen=True, slots=True)
class Unevenness:
    """How the cameras of a ring stand that somebody walked, in random order.

    Attributes:
        seed: Of all that follows.
        steps: Share by which the angles between neighbours differ at most from even ones.
        pitch_deg: How far cameras are above or below the horizon at most, degrees.
        distance: Share by which distances differ at most from the radius.
        roll_deg: By how much pictures are turned at most, degrees.
        aim_m: How far beside the origin cameras look at most along each axis, metres.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    seed: int = 0
    steps: float = 1 / 3
    pitch_deg: float = 15.0
    distance: float = 0.25
    roll_deg: float = 3.0
    aim_m: float = 0.05

    def poses(self, views: int, radius_m: float) -> list[Floats]:
        """(4, 4) ``world_to_camera`` of each view, in random order."""
        rng = np.random.default_rng(self.seed)
        steps = 1 + rng.uniform(-self.steps, self.steps, views)
        yaws = 2 * math.pi * np.cumsum(steps) / steps.sum() + rng.uniform(0, 2 * math.pi)
        poses: list[Floats] = []
        for yaw in rng.permutation(yaws):
            pitch = math.radians(rng.uniform(-self.pitch_deg, self.pitch_deg))
            roll = math.radians(rng.uniform(-self.roll_deg, self.roll_deg))
            distance = radius_m * (1 + rng.uniform(-self.distance, self.distance))
            level = np.array([math.sin(yaw), 0.0, math.cos(yaw)])
            place = math.cos(pitch) * level + [0.0, math.sin(pitch), 0.0]
            side = np.array([math.cos(yaw), 0.0, -math.sin(yaw)])
            up = math.sin(roll) * side + [0.0, math.cos(roll), 0.0]
            aim = rng.uniform(-self.aim_m, self.aim_m, 3)
            poses.append(look_at(distance * place, aim, up))
        return poses


@dataclass(frozen=True, slots=True)
class RingRig:
    """Cameras evenly spaced on a circle around what they look at, all at one pitch.

    Yaw is 0 in front of the subject (on +Z) and grows towards its left (+X). By default view 0 is
    frontal: with eight views, our ``ring8``, number 2 is on +X and number 4 is the back. The
    published file numbers the same eight places starting at +X, with number 6 in front.

    Attributes:
        views: Number of cameras.
        radius_m: Distance of every camera from what it looks at, metres.
        pitch_deg: How far the cameras are lifted above the horizon, degrees; they keep looking at
            the same point.
        lens_mm: Focal length, millimetres.
        sensor_mm: Sensor length along the image's longer side, millimetres.
        first_yaw_deg: Yaw of view 0, degrees.
        span_m: What the image's longer side spans, metres: the cameras are orthographic, and lens
            and sensor do not count. 0 for perspective ones.
        span_heights: The same, as a multiple of the subject's height.
        about: What they look at: the world's origin, where the middle of the subject's ``box`` is;
            the ``root`` joint of its true body, the pelvis; or its ``axis``, the point above or
            below that joint in the middle of the box's height.
        target_m: (x, y, z) of what they look at, world metres; ``about`` moves it.
        uneven: How cameras stand instead, if not evenly; pitch and first yaw then say nothing.
    """

    views: int = 8
    radius_m: float = 3.0
    pitch_deg: float = 0.0
    lens_mm: float = 50.0
    sensor_mm: float = 36.0
    first_yaw_deg: float = 0.0
    span_m: float = 0.0
    span_heights: float = 0.0
    about: Literal["box", "root", "axis"] = "box"
    target_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    uneven: Unevenness | None = None

    def placed(self, bounds: Floats, root: Floats | None) -> RingRig:
        """The ring about one subject.

        Args:
            bounds: (2, 3) corners of the subject's box, world metres.
            root: (3,) the true body's first joint, world metres; None takes the middle of the box.
        """
        low, high = bounds
        span_m = self.span_m or self.span_heights * float(high[1] - low[1])
        if self.about == "box" or root is None:
            return replace(self, span_m=span_m)
        x, y, z = (float(each) for each in root)
        middle = y if self.about == "root" else float(low[1] + high[1]) / 2
        return replace(self, span_m=span_m, target_m=(x, middle, z))

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values; what was added later is not said where it is as it always was."""
        later = {each.name: each.default for each in fields(self)[-5:]}
        return {
            name: value
            for name, value in asdict(self).items()
            if name not in later or value != later[name]
        }

    def cameras(self, width: int, height: int) -> tuple[Camera, ...]:
        """The rig's cameras for images of ``width`` x ``height`` pixels, by number.

        Raises:
            DataError: how wide an image is depends on a subject, and the ring is not ``placed``.
        """
        if self.span_heights and not self.span_m:
            raise DataError("a ring as wide as its subject is high has to be placed about one")
        focal = focal_length_px(self.lens_mm, self.sensor_mm, width, height)
        if self.span_m:
            focal = max(width, height) / self.span_m
        target = np.array(self.target_m)
        K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
        if self.uneven is not None:
            poses = self.uneven.poses(self.views, self.radius_m)
            return tuple(Camera(K, pose, width, height) for pose in poses)
        pitch = math.radians(self.pitch_deg)
        cameras: list[Camera] = []
        for view in range(self.views):
            yaw = math.radians(self.first_yaw_deg) + 2 * math.pi * view / self.views
            direction = np.array(
                [
                    math.cos(pitch) * math.sin(yaw),
                    math.sin(pitch),
                    math.cos(pitch) * math.cos(yaw),
                ]
            )
            extrinsic = look_at(target + self.radius_m * direction, target)
            kind = "orthographic" if self.span_m else "perspective"
            cameras.append(Camera(K, extrinsic, width, height, kind))
        return tuple(cameras)


@dataclass(frozen=True, slots=True)
class PhotoFaults:
    """How photos and cameras differ from exact ones. Masks stay exact.

    Attributes:
        noise: Standard deviation of the sensor's noise at middle grey, in levels of 255; shot noise
            grows with the square root of the light.
        blur_px: Standard deviation of the lens' blur, pixels.
        exposure_stops: Standard deviation of the exposure from view to view, in stops.
        jpeg_quality: Quality of the compression, 1 to 100 as Pillow counts; 0 does not compress.
        calibration_px: Root mean square of the re-projection error over the subject's box, of the
            cameras that methods are given; the photos are taken with the exact ones.
        sway_mm: Root mean square by which the head moves sideways from photo to photo, as the body
            leans and bends; the truth is the scan as it is.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    noise: float = 0.0
    blur_px: float = 0.0
    exposure_stops: float = 0.0
    jpeg_quality: int = 0
    calibration_px: float = 0.0
    sway_mm: float = 0.0

    def __post_init__(self) -> None:
        ranges = {
            "noise": 50.0,
            "blur_px": 20.0,
            "exposure_stops": 3.0,
            "jpeg_quality": 100.0,
            "calibration_px": 50.0,
            "sway_mm": 100.0,
        }
        for name, most in ranges.items():
            if not 0 <= getattr(self, name) <= most:
                raise DataError(
                    f"photos cannot be taken with {name} {getattr(self, name)}",
                    expected=f"0 to {most:g}",
                )

    @property
    def changes_pictures(self) -> bool:
        """Whether the pictures differ from exact ones."""
        return any((self.noise, self.blur_px, self.exposure_stops, self.jpeg_quality))
