"""A camera of either kind: the only code that projects, unprojects, resizes, crops or turns one.

A perspective camera sees along rays through its optical centre, an orthographic one along its axis.
Weak perspective is an orthographic camera whose scale is that of one depth: ``weak_perspective``.

OpenCV axes: x right, y down, z forward. The centre of the top-left pixel is (0.5, 0.5), so an image
of width w spans x from 0 to w; this is the one place where that half pixel is decided.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from harness.core.arrays import Floats
from harness.core.errors import DataError

Kind = Literal["perspective", "orthographic"]
_ROTATION_TOLERANCE = 1e-5


def rigid_inverse(transform: Floats) -> Floats:
    """The inverse of a 4x4 rigid transform, by transposing its rotation."""
    inverse = np.eye(4)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverse


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """An immutable calibrated camera.

    Attributes:
        K: (3, 3) intrinsics, last row (0, 0, 1): pixels, or of an orthographic camera pixels per
            metre where a perspective one has its focal lengths.
        world_to_camera: (4, 4) rigid transform from world metres to OpenCV camera metres.
        width: Image width in pixels.
        height: Image height in pixels.
        kind: ``perspective`` or ``orthographic``. Depths of an orthographic camera count from the
            plane of its origin, and it does not see what lies behind, as a perspective one.

    Raises:
        DataError: wrong shapes, non-finite numbers, a focal length or size that is not positive,
            skew, a rotation that is not one, or another kind.
    """

    K: Floats
    world_to_camera: Floats
    width: int
    height: int
    kind: Kind = "perspective"

    def __post_init__(self) -> None:
        for name, shape in (("K", (3, 3)), ("world_to_camera", (4, 4))):
            # A copy, so that nobody holds a writeable view of what is immutable here.
            array = np.array(getattr(self, name), dtype=np.float64, copy=True)
            if array.shape != shape or not np.isfinite(array).all():
                raise DataError(
                    f"camera {name} is not usable",
                    expected=f"finite, shape {shape}",
                    got=f"shape {array.shape}, finite {bool(np.isfinite(array).all())}",
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        self._check()

    def _check(self) -> None:
        rotation = self.world_to_camera[:3, :3]
        if self.kind not in ("perspective", "orthographic"):
            raise DataError(
                "not a kind of camera", expected="perspective or orthographic", got=str(self.kind)
            )
        if self.width < 1 or self.height < 1:
            raise DataError("camera has no pixels", got=f"{self.width} x {self.height}")
        fx, skew, _, shear, fy, _, *last = self.K.ravel()
        if fx <= 0 or fy <= 0 or skew or shear or last != [0, 0, 1]:
            raise DataError(
                "camera K is not an intrinsic matrix",
                expected="(fx, 0, cx), (0, fy, cy), (0, 0, 1) with positive focal lengths",
                got=str(self.K.tolist()),
            )
        orthogonal = np.allclose(rotation @ rotation.T, np.eye(3), atol=_ROTATION_TOLERANCE)
        if not orthogonal or np.linalg.det(rotation) < 0:
            raise DataError(
                "camera world_to_camera is not rigid",
                expected="a right-handed rotation",
                got=f"determinant {np.linalg.det(rotation):.4f}",
                hint="A scaled or mirrored pose comes from another convention: convert it first",
            )

    @property
    def size(self) -> tuple[int, int]:
        """Image width and height in pixels."""
        return self.width, self.height

    @property
    def rotation(self) -> Floats:
        """(3, 3) rotation from world axes to camera axes."""
        return self.world_to_camera[:3, :3]

    @property
    def camera_to_world(self) -> Floats:
        """(4, 4) rigid transform from camera metres to world metres."""
        return rigid_inverse(self.world_to_camera)

    @property
    def is_orthographic(self) -> bool:
        """Whether its rays are parallel."""
        return self.kind == "orthographic"

    @property
    def position(self) -> Floats:
        """(3,) the camera's origin in world metres: the optical centre of a perspective one."""
        return self.camera_to_world[:3, 3]

    @property
    def forward(self) -> Floats:
        """(3,) unit viewing direction in world axes."""
        return self.rotation[2]

    @property
    def projection(self) -> Floats:
        """(3, 4) from homogeneous world points to homogeneous pixels."""
        in_camera = self.world_to_camera[:3]
        if self.is_orthographic:
            in_camera = np.stack([*in_camera[:2], [0.0, 0.0, 0.0, 1.0]])
        return self.K @ in_camera

    def spread(self, depth: ArrayLike) -> Floats:
        """What a pixel's extent grows with: depths (...) in metres, or 1 with parallel rays.

        A pixel spans ``spread(depth) / K[0, 0]`` metres.
        """
        depth = np.asarray(depth)
        return np.ones_like(depth) if self.is_orthographic else depth

    def eye_of(self, points_world: Floats) -> Floats:
        """(N, 3) where the rays to world points (N, 3) start: the optical centre where all meet.

        The rays of an orthographic camera start in the plane through its origin.
        """
        if self.is_orthographic:
            away = (points_world - self.position) @ self.forward
            return points_world - away[:, None] * self.forward
        return np.broadcast_to(self.position, points_world.shape)

    def project(self, points_world: ArrayLike) -> tuple[Floats, Floats]:
        """Pixels (N, 2) and depths (N,) in metres of world points (N, 3).

        Depth is along the optical axis; a point at or behind the camera has NaN pixels.
        """
        points = np.asarray(points_world, dtype=np.float64)
        in_camera = points @ self.rotation.T + self.world_to_camera[:3, 3]
        depth = in_camera[:, 2]
        if self.is_orthographic:
            in_camera = np.column_stack([in_camera[:, :2], np.ones(len(points))])
        with np.errstate(divide="ignore", invalid="ignore"):
            normalised = in_camera / np.where(depth > 0, self.spread(depth), np.nan)[:, None]
        return (normalised @ self.K.T)[:, :2], depth

    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> Floats:
        """World points (N, 3) at pixels (N, 2) and depths (N,) in metres along the optical axis."""
        depth = np.asarray(depth, dtype=np.float64)
        in_camera = self._rays_camera(pixels)
        if self.is_orthographic:
            in_camera[:, 2] = depth
        else:
            in_camera *= depth[:, None]
        return (in_camera - self.world_to_camera[:3, 3]) @ self.rotation

    def ray_directions(self, pixels: ArrayLike) -> Floats:
        """World directions (N, 3) through pixels (N, 2), of unit depth along the optical axis."""
        if self.is_orthographic:
            return np.tile(self.forward, (len(np.asarray(pixels)), 1))
        return self._rays_camera(pixels) @ self.rotation

    def ray_origins(self, pixels: ArrayLike) -> Floats:
        """World points (N, 3) where the rays through pixels (N, 2) start."""
        if self.is_orthographic:
            return self.unproject(pixels, np.zeros(len(np.asarray(pixels))))
        return np.broadcast_to(self.position, (len(np.asarray(pixels)), 3))

    def _rays_camera(self, pixels: ArrayLike) -> Floats:
        pixels = np.asarray(pixels, dtype=np.float64)
        homogeneous = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1)
        return homogeneous @ np.linalg.inv(self.K).T

    def pixel_centres(self) -> Floats:
        """(height, width, 2) pixel coordinates (x, y) of every pixel's centre."""
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return np.stack([x, y], axis=-1)

    def resized(self, width: int, height: int) -> Camera:
        """The camera of the same picture resampled to another size in pixels."""
        scale = np.diag([width / self.width, height / self.height, 1.0])
        return replace(self, K=scale @ self.K, width=width, height=height)

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """The camera of a window of the picture; the window may reach outside it."""
        return replace(self.shifted(-left, -top), width=width, height=height)

    def shifted(self, right_px: float, down_px: float) -> Camera:
        """The camera of a picture that shows everything further to the right and down."""
        shift = np.array([[1.0, 0.0, right_px], [0.0, 1.0, down_px], [0.0, 0.0, 1.0]])
        return replace(self, K=shift @ self.K)

    def turned(self, rotation_camera: ArrayLike) -> Camera:
        """The camera turned about its optical centre by a (3, 3) rotation in its own axes."""
        turn = np.eye(4)
        turn[:3, :3] = np.asarray(rotation_camera, dtype=np.float64)
        return replace(self, world_to_camera=turn @ self.world_to_camera)

    def weak_perspective(self, depth_m: float) -> Camera:
        """The orthographic camera that sees what lies at a depth, metres, as this one does."""
        if self.is_orthographic:
            return self
        return replace(self, kind="orthographic").posed(self.world_to_camera, depth_m)

    def posed(self, world_to_camera: Floats, scale: float) -> Camera:
        """The camera of the same picture with another pose, in a world ``scale`` times as large."""
        shrunk = np.diag([1.0 / scale, 1.0 / scale, 1.0])
        K = self.K @ shrunk if self.is_orthographic else self.K
        return replace(self, K=K, world_to_camera=world_to_camera)

    def in_frame(self, world_to_other: Floats) -> Camera:
        """The same camera described in another world frame, by a (4, 4) rigid transform to it."""
        return replace(self, world_to_camera=self.world_to_camera @ rigid_inverse(world_to_other))

    def to_dict(self) -> dict[str, object]:
        """Plain JSON values; ``Camera.from_dict`` reads them back without loss.

        ``kind`` is said where the camera is orthographic; without it a camera is perspective.
        """
        values: dict[str, object] = {
            "K": self.K.tolist(),
            "world_to_camera": self.world_to_camera.tolist(),
            "width": self.width,
            "height": self.height,
        }
        return {**values, "kind": self.kind} if self.is_orthographic else values

    @classmethod
    def from_dict(cls, value: Mapping[str, Any]) -> Camera:
        """The camera that ``to_dict`` wrote.

        Raises:
            DataError: not such a mapping, or not a camera.
        """
        try:
            return cls(
                K=np.array(value["K"], dtype=np.float64),
                world_to_camera=np.array(value["world_to_camera"], dtype=np.float64),
                width=int(value["width"]),
                height=int(value["height"]),
                kind=value.get("kind", "perspective"),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(
                "not a camera", expected="K, world_to_camera, width, height", got=repr(error)
            ) from error


def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Floats:
    """(4, 4) world_to_camera of a camera at ``position`` (metres) that looks at ``target``.

    Raises:
        DataError: the viewing direction is parallel to ``up`` or has no length.
    """
    position = np.asarray(position, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - position
    right = np.cross(forward, np.asarray(up, dtype=np.float64))
    if np.linalg.norm(right) < 1e-12:
        raise DataError("look_at has no unique answer", got=f"direction {forward} along up {up}")
    forward = forward / np.linalg.norm(forward)
    right = right / np.linalg.norm(right)
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    world_to_camera[:3, 3] = -world_to_camera[:3, :3] @ position
    return world_to_camera
