"""Camera rigs: named arrangements of cameras around the subject."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.core.camera import Camera, look_at

__all__ = ["RingRig", "focal_length_px"]


def focal_length_px(lens_mm: float, sensor_mm: float, width: int, height: int) -> float:
    """Focal length in pixels of a lens whose sensor is fitted to the image's longer side."""
    return lens_mm / sensor_mm * max(width, height)


@dataclass(frozen=True, slots=True)
class RingRig:
    """Cameras evenly spaced on a circle round the subject's centre, all at one pitch.

    View 0 is frontal (on +Z); yaw grows towards the subject's left (+X), so that of eight views the
    third is on +X and the fifth is the back. The defaults are the paper's ``ring8``.

    Attributes:
        views: Number of cameras.
        radius_m: Distance of every camera from the origin, metres.
        pitch_deg: How far the cameras are lifted above the horizon, degrees; they keep looking at
            the origin.
        lens_mm: Focal length, millimetres.
        sensor_mm: Sensor length along the image's longer side, millimetres.
    """

    views: int = 8
    radius_m: float = 3.0
    pitch_deg: float = 0.0
    lens_mm: float = 50.0
    sensor_mm: float = 36.0

    def cameras(self, width: int, height: int) -> tuple[Camera, ...]:
        """The rig's cameras for images of ``width`` x ``height`` pixels, in order of yaw."""
        focal = focal_length_px(self.lens_mm, self.sensor_mm, width, height)
        K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
        pitch = math.radians(self.pitch_deg)
        cameras: list[Camera] = []
        for view in range(self.views):
            yaw = 2 * math.pi * view / self.views
            direction = np.array(
                [
                    math.cos(pitch) * math.sin(yaw),
                    math.sin(pitch),
                    math.cos(pitch) * math.cos(yaw),
                ]
            )
            extrinsic = look_at(self.radius_m * direction, np.zeros(3))
            cameras.append(Camera(K=K, world_to_camera=extrinsic, width=width, height=height))
        return tuple(cameras)
