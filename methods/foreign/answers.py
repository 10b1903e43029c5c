"""What a foreign method wrote, read as what it is: a mesh, depth maps, points or Gaussians.

A result in a world of the method's own may have ``cameras.npz`` beside it: ``intrinsics`` (S, 3, 3)
and ``world_to_camera`` (S, 4, 4) of its photos, OpenCV axes, on the photos' pixels. ``report.json``
beside a result is told in the record.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Reconstruction
from harness.core.camera import Camera, rigid_inverse
from harness.core.camera_frames import BLENDER_TO_WORLD, quaternion_from_rotation
from harness.core.errors import DataError, MethodError
from harness.core.files.atomic import read_json
from harness.core.files.npz import read_array_npz
from harness.core.mesh import Mesh
from harness.core.results import DepthMaps, Gaussians, PhotoFrame, PointCloud, Unmeshed, ViewDepth
from harness.files.mesh_files import load_mesh
from harness.files.point_files import load_points
from methods.foreign.method_file import MethodFile

_CAMERAS, _REPORT = "cameras.npz", "report.json"
_NOUNS = {"mesh": "mesh", "depth": "depth maps", "points": "points", "gaussians": "Gaussians"}


@dataclass(frozen=True, slots=True)
class AnswerFolder:
    """Where a method wrote its answer.

    Attributes:
        method: The method.
        folder: The folder.
        photos: Width and height of each photo that it was given, pixels.
    """

    method: MethodFile
    folder: Path
    photos: Sequence[tuple[int, int]]

    def read(self, log: str) -> Reconstruction | Unmeshed:
        """The result.

        Args:
            log: The end of what the command printed, for a message.

        Raises:
            MethodError: there is none, or it cannot be used.
        """
        method, path = self.method, self.folder / self.method.answer
        noun = _NOUNS[method.result]
        if path.is_symlink() or not path.is_file():
            raise MethodError(
                f"the command of method '{method.name}' wrote no {noun}",
                expected=f"a file at {{result}}, called {method.answer}",
                hint=log,
            )
        try:
            if method.result == "mesh":
                mesh = replace(load_mesh(path).geometry(), source=f"the mesh of '{method.name}'")
                return Reconstruction(in_our_world(mesh, method.up), details=self._report())
            if method.result == "depth":
                return self._depth(read_array_npz(path))
            return self._points(path)
        except DataError as error:
            raise MethodError(
                f"the {noun} of method '{method.name}' cannot be used: {error}"
            ) from error

    def _report(self) -> dict[str, object]:
        path = self.folder / _REPORT
        return dict(read_json(path)) if path.is_file() and not path.is_symlink() else {}

    def _depth(self, arrays: Mapping[str, NDArray[Any]]) -> DepthMaps:
        depth = self._array(arrays, "depth", (None, None))
        confidence: Sequence[Floats | None] = [None] * len(depth)
        if "confidence" in arrays:
            confidence = list(self._array(arrays, "confidence", depth.shape[1:]))
        size = depth.shape[2], depth.shape[1]
        frames = [PhotoFrame.whole(photo, size) for photo in self.photos]
        if "resized" in arrays:
            resized, shift = (self._array(arrays, name, (2,)) for name in ("resized", "shift"))
            frames = [
                PhotoFrame(photo, (int(w), int(h)), (int(x), int(y)), size)
                for photo, (w, h), (x, y) in zip(self.photos, resized, shift, strict=True)
            ]
        cameras = self._cameras(arrays, [size] * len(depth))
        views = zip(frames, cameras, depth, confidence, strict=True)
        return DepthMaps(tuple(ViewDepth(*each) for each in views), self._report())

    def _points(self, path: Path) -> PointCloud | Gaussians:
        found = load_points(path)
        if found is None:
            raise DataError(f"{path.name} has faces", expected="a PLY file of points alone")
        wanted = Gaussians if self.method.result == "gaussians" else PointCloud
        if not isinstance(found, wanted):
            raise DataError(f"{path.name} holds other points than {_NOUNS[self.method.result]}")
        cameras, beside = None, self.folder / _CAMERAS
        if beside.is_file() and not beside.is_symlink():
            cameras = tuple(self._cameras(read_array_npz(beside), self.photos))
        turn = np.eye(3) if self.method.up == "+y" else BLENDER_TO_WORLD[:3, :3]
        report = self._report()
        if isinstance(found, PointCloud):
            normals = None if found.normals is None else found.normals @ turn.T
            return PointCloud(found.positions @ turn.T, normals, cameras, report)
        turned = found.rotations
        if self.method.up != "+y":
            turned = np.array([quaternion_from_rotation(turn @ axes) for axes in found.axes()])
        return replace(
            found,
            centres=found.centres @ turn.T,
            rotations=turned,
            cameras=cameras,
            details=report,
        )

    def _cameras(
        self, arrays: Mapping[str, NDArray[Any]], sizes: Sequence[tuple[int, int]]
    ) -> list[Camera]:
        intrinsics = self._array(arrays, "intrinsics", (3, 3))
        moves = self._array(arrays, "world_to_camera", (4, 4))
        turn = np.eye(4) if self.method.up == "+y" else rigid_inverse(BLENDER_TO_WORLD)
        return [
            Camera(K, _orthonormal(move) @ turn, *size)
            for K, move, size in zip(intrinsics, moves, sizes, strict=True)
        ]

    def _array(
        self, arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int | None, ...]
    ) -> Floats:
        """An array with one entry for each photo, in double precision.

        Raises:
            DataError: it is not there, or of another shape.
        """
        found = arrays.get(name)
        expected = (len(self.photos), *shape)
        got = "none" if found is None else f"shape {found.shape} of {found.dtype}"
        wrong = f"its array '{name}' is not usable"
        if found is None or found.ndim != len(expected) or found.dtype.kind not in "fiu":
            raise DataError(wrong, expected=f"numbers of shape {expected}", got=got)
        if any(want not in (None, have) for want, have in zip(expected, found.shape, strict=True)):
            raise DataError(wrong, expected=f"shape {expected}", got=got)
        return found.astype(np.float64)


def in_our_world(mesh: Mesh, up: str) -> Mesh:
    """A mesh from the world that a method works in."""
    if up == "+y":
        return mesh
    return replace(mesh, vertices=mesh.vertices @ BLENDER_TO_WORLD[:3, :3].T)


def _orthonormal(move: Floats) -> Floats:
    """A transform that was computed in single precision, its rotation made exact."""
    left, _, right = np.linalg.svd(move[:3, :3])
    exact = np.array(move, dtype=np.float64)
    exact[:3, :3] = left @ right
    return exact
