"""VGGT's open kin, in the same shape: Depth Anything 3 and MapAnything.

Both take known cameras as input, so that their depth comes in metres and in the known frame; that
is their default here (``native_posed``). Sources: Lin et al., "Depth Anything 3: Recovering the
visual space from any views", 2025; Keetha et al., "MapAnything: Universal feed-forward metric 3D
reconstruction", 2025.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.camera import Camera, rigid_inverse
from harness.core.errors import HarnessError, MethodError
from methods.feedforward.source import (
    NetworkSettings,
    NetworkSize,
    Prepared,
    fitted_photos,
    required,
)
from methods.foreign.running import Answer
from methods.points.cloud import Frame, fitted_picture
from methods.points.sources import SourceRequest, ViewDepth

_PATCH = 14
_ALIGNMENTS = ("native_posed", "sim3_cameras", "known_cameras", "oracle_icp")
#: How far an answer's cameras may be from those that were given, metres and rotation's entries.
_SAME = 1e-3


@dataclass(frozen=True, slots=True)
class DepthAnything3:
    """How Depth Anything 3 is asked; see ``Dialect``. It resizes the pictures itself."""

    name: str = "da3"
    title: str = "Depth Anything 3 BASE"
    alignments: tuple[str, ...] = _ALIGNMENTS
    worker_module: ClassVar[str] = "methods.feedforward.workers.da3.worker"

    def check(self, settings: NetworkSettings) -> None:
        """Refuse another fit or precision than the package's own.

        Raises:
            HarnessError: either.
        """
        for name, value, own in (
            ("fit", settings.fit, "fit"),
            ("precision", settings.precision, "auto"),
        ):
            if value != own:
                raise HarnessError(
                    f"setting 'network.{name}' of Depth Anything 3 cannot be '{value}'",
                    expected=f"{own}, since its package decides that itself",
                )

    def size(self, weights_bytes: int) -> NetworkSize:
        """As published: 12 blocks of 768 numbers, of which two sets are handed on."""
        return NetworkSize(weights_bytes, width=1536, blocks=12, patch=_PATCH)

    def prepared(self, request: SourceRequest, settings: NetworkSettings) -> Prepared:
        """The photos over a plain grey, in full size.

        Raises:
            MethodError: photos of several sizes.
        """
        sizes = {photo.camera.size for photo in request.photos}
        if len(sizes) > 1:
            raise MethodError("photos of several sizes cannot be sent", got=str(sorted(sizes)))
        frames = [Frame.whole(photo.camera.size, photo.camera.size) for photo in request.photos]
        images = [
            fitted_picture(photo.rgba, frame, settings.background)
            for photo, frame in zip(request.photos, frames, strict=True)
        ]
        cameras = [photo.camera for photo in request.photos]
        return Prepared(frames, np.stack(images), cameras if request.give_cameras else None)

    def arrays(self, prepared: Prepared) -> Mapping[str, NDArray[Any]]:
        """The known cameras, where they are given."""
        if prepared.cameras is None:
            return {}
        return {
            "intrinsics": np.stack([camera.K for camera in prepared.cameras]),
            "extrinsics": np.stack([camera.world_to_camera for camera in prepared.cameras]),
        }

    def views(self, answer: Answer, prepared: Prepared) -> tuple[ViewDepth, ...]:
        """Depth on the pixels that the network chose, with its cameras."""
        arrays = required(answer, "depth", "confidence", "intrinsics", "extrinsics")
        depth = arrays["depth"].astype(np.float64)
        size = depth.shape[2], depth.shape[1]
        frames = [Frame.whole(frame.photo, size) for frame in prepared.frames]
        cameras = [
            Camera(K, _square(move), *size)
            for K, move in zip(arrays["intrinsics"], arrays["extrinsics"], strict=True)
        ]
        if prepared.cameras is not None:
            known = [f.camera(c) for f, c in zip(frames, prepared.cameras, strict=True)]
            _require_given(cameras, known, intrinsics_px=1.0)
        confidence = arrays["confidence"].astype(np.float64)
        return tuple(
            ViewDepth(*each) for each in zip(frames, cameras, depth, confidence, strict=True)
        )


@dataclass(frozen=True, slots=True)
class MapAnything:
    """How MapAnything is asked; see ``Dialect``."""

    name: str = "mapanything"
    title: str = "MapAnything (Apache)"
    alignments: tuple[str, ...] = _ALIGNMENTS
    worker_module: ClassVar[str] = "methods.feedforward.workers.mapanything.worker"

    def check(self, settings: NetworkSettings) -> None:
        """It takes notice of all."""

    def size(self, weights_bytes: int) -> NetworkSize:
        """About: 24 blocks of 1024 numbers for photos, and as many for what they share."""
        return NetworkSize(weights_bytes, width=2048, blocks=24, patch=_PATCH)

    def prepared(self, request: SourceRequest, settings: NetworkSettings) -> Prepared:
        """The photos, fitted."""
        return fitted_photos(request, settings, _PATCH)

    def arrays(self, prepared: Prepared) -> Mapping[str, NDArray[Any]]:
        """The known cameras, where they are given."""
        if prepared.cameras is None:
            return {}
        return {
            "intrinsics": np.stack([camera.K for camera in prepared.cameras]),
            "camera_to_world": np.stack([camera.camera_to_world for camera in prepared.cameras]),
        }

    def views(self, answer: Answer, prepared: Prepared) -> tuple[ViewDepth, ...]:
        """Depth with the network's cameras, or in those that it was given.

        With cameras given its world is metric but starts at its first camera; depth is along the
        optical axis either way.
        """
        arrays = required(answer, "depth", "confidence", "intrinsics", "camera_to_world")
        depth = arrays["depth"].astype(np.float64)
        confidence = arrays["confidence"].astype(np.float64)
        cameras = prepared.cameras
        if cameras is None:
            cameras = [
                Camera(K, rigid_inverse(_orthonormal(move)), *frame.size)
                for K, move, frame in zip(
                    arrays["intrinsics"].astype(np.float64),
                    arrays["camera_to_world"].astype(np.float64),
                    prepared.frames,
                    strict=True,
                )
            ]
        return tuple(
            ViewDepth(*each)
            for each in zip(prepared.frames, cameras, depth, confidence, strict=True)
        )


def _square(move: NDArray[Any]) -> Floats:
    """(4, 4) of a (3, 4) transform, its rotation made exact."""
    whole = np.eye(4)
    whole[:3] = move[:3]
    return _orthonormal(whole)


def _orthonormal(move: Floats) -> Floats:
    """A transform that was computed in single precision, its rotation made exact."""
    left, _, right = np.linalg.svd(move[:3, :3])
    exact = np.array(move, dtype=np.float64)
    exact[:3, :3] = left @ right
    return exact


def _require_given(found: Sequence[Camera], given: Sequence[Camera], intrinsics_px: float) -> None:
    """Refuse an answer in other cameras than those that the network was told to keep."""
    for view, (own, known) in enumerate(zip(found, given, strict=True)):
        apart = float(np.abs(own.world_to_camera - known.world_to_camera).max())
        pixels = float(np.abs(own.K - known.K).max())
        if apart > _SAME or pixels > intrinsics_px:
            raise MethodError(
                f"the network did not keep the camera of photo {view + 1}",
                expected="the cameras that it was given",
                got=f"poses {apart:.3g} apart, intrinsics {pixels:.3g} px",
                hint="Set align.mode=sim3_cameras to take its own cameras",
            )


#: The network's unprojection counts pixels by whole numbers and has the principal point at half the
#: picture; here the centre of the first pixel is at 0.5, so that the point moves by as much.
_HALF_PIXEL = 0.5


def decoded_cameras(encoded: Floats, size: tuple[int, int]) -> tuple[Camera, ...]:
    """The cameras behind pose encodings (S, 9), in the network's own world and unit.

    An encoding is the shift (3) and the quaternion x, y, z, w of world-to-camera in OpenCV's axes,
    then the vertical and the horizontal field of view, radians.

    Args:
        encoded: (S, 9).
        size: Width and height of the network's pictures.

    Raises:
        MethodError: encodings that are not finite, or without a rotation or a field of view.
    """
    width, height = size
    encoded = np.asarray(encoded, dtype=np.float64)
    length = np.linalg.norm(encoded[:, 3:7], axis=1)
    fields = encoded[:, 7:9]
    good = np.isfinite(encoded).all(axis=1) & (length > 0)
    good &= ((fields > 0) & (fields < np.pi)).all(axis=1)
    if not good.all():
        view = int(np.argmin(good))
        raise MethodError(
            f"the network found no camera for photo {view + 1} of {len(encoded)}",
            expected="a rotation, and fields of view between 0 and 180 degrees",
            got=np.array2string(encoded[view], precision=3),
        )
    cameras: list[Camera] = []
    for row, norm in zip(encoded, length, strict=True):
        move = np.eye(4)
        move[:3, :3] = _rotation(row[3:7] / norm)
        move[:3, 3] = row[:3]
        fy, fx = height / 2.0 / np.tan(row[7] / 2.0), width / 2.0 / np.tan(row[8] / 2.0)
        cx, cy = width / 2.0 + _HALF_PIXEL, height / 2.0 + _HALF_PIXEL
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        cameras.append(Camera(K, move, width, height))
    return tuple(cameras)


def _rotation(quaternion: Floats) -> Floats:
    """(3, 3) of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


_PATCH_VGGT = 14


@dataclass(frozen=True, slots=True)
class Vggt:
    """How VGGT is asked; see ``Dialect``."""

    name: str = "vggt"
    title: str = "VGGT"
    alignments: tuple[str, ...] = ("sim3_cameras", "known_cameras", "oracle_icp")
    worker_module: ClassVar[str] = "methods.feedforward.workers.vggt.worker"

    def check(self, settings: NetworkSettings) -> None:
        """It takes notice of all."""

    def size(self, weights_bytes: int) -> NetworkSize:
        """As published: 24 blocks that hand on 2048 numbers for each patch."""
        return NetworkSize(weights_bytes, width=2048, blocks=24, patch=_PATCH_VGGT)

    def prepared(self, request: SourceRequest, settings: NetworkSettings) -> Prepared:
        """The photos, fitted."""
        return fitted_photos(request, settings, _PATCH_VGGT)

    def arrays(self, prepared: Prepared) -> Mapping[str, NDArray[Any]]:  # noqa: ARG002
        """Only pictures."""
        return {}

    def views(self, answer: Answer, prepared: Prepared) -> tuple[ViewDepth, ...]:
        """Depth with the decoded cameras."""
        arrays = required(answer, "pose_enc", "depth", "confidence")
        cameras = decoded_cameras(arrays["pose_enc"], prepared.frames[0].size)
        return tuple(
            ViewDepth(frame, camera, depth, confidence)
            for frame, camera, depth, confidence in zip(
                prepared.frames,
                cameras,
                arrays["depth"].astype(np.float64),
                arrays["confidence"].astype(np.float64),
                strict=True,
            )
        )
