"""Rays against a mesh: depth, masks, normals and visibility from any camera.

A mesh has two sides along a camera's rays: ``near`` is what a ray meets first, ``far`` what it
meets last. ECON's front and back maps, which share one pixel grid, are the near and the far side of
their photo; under full perspective the far side is therefore not what a second camera sees. The
words front and back are left for the person and for those maps.

One Embree scene (Open3D's ``RaycastingScene``) per mesh, moved to the mesh's centre because Embree
computes in float32: from 3 m away a depth is then good to a few micrometres.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.camera_frames import OPENCV_TO_BLENDER_CAMERA
from harness.core.mesh import Mesh
from harness.geometry.surface import vertex_normals
from harness.geometry.window import Window, is_cut

Frame = Literal["world", "camera"]
#: The first and the last surface along the rays of a camera.
Side = Literal["near", "far"]

#: Rays per call, which bounds memory to about 100 MB whatever the picture's size.
_BATCH = 1 << 20
#: The rays to the far side start this much behind the mesh, metres.
_BEHIND_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """What each pixel's central ray meets, first or last.

    Attributes:
        depth: (H, W) metres along the optical axis; NaN where nothing is met.
        face: (H, W) int32 index of the triangle; -1 where nothing is met.
        barycentric: (H, W, 3) float32 weights of the triangle's corners; 0 where nothing is met.
    """

    depth: Floats
    face: NDArray[np.int32]
    barycentric: NDArray[np.float32]

    @classmethod
    def nothing(cls, camera: Camera) -> Hits:
        """A camera's picture in which no ray has met anything; to be filled."""
        shape = (camera.height, camera.width)
        return cls(
            depth=np.full(shape, np.nan),
            face=np.full(shape, -1, dtype=np.int32),
            barycentric=np.zeros((*shape, 3), dtype=np.float32),
        )

    def fill(self, where: tuple[slice, slice], depth: Floats, answer: Any) -> None:
        """Write Open3D's answer to the rays of some rows and columns, met where depth is finite."""
        met = np.isfinite(depth)
        face = answer["primitive_ids"].numpy().reshape(depth.shape)
        self.depth[where][met] = depth[met]
        self.face[where][met] = face[met].astype(np.int32)
        # Open3D's (u, v) weigh the second and third corner.
        second_third = answer["primitive_uvs"].numpy().reshape(*depth.shape, 2)[met]
        weights = np.column_stack([1.0 - second_third.sum(axis=1), second_third])
        self.barycentric[where][met] = weights

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) whether anything is met."""
        return self.face >= 0

    def interpolate(self, values: ArrayLike, corners: NDArray[np.integer[Any]]) -> Floats:
        """(H, W, C) corner values blended at every hit; 0 where nothing is met.

        Args:
            values: (N, C), one row per vertex or texture coordinate.
            corners: (F, 3) rows of ``values`` at the corners of each face: ``mesh.faces`` for
                values per vertex, ``mesh.face_uv`` for texture coordinates.
        """
        values = np.asarray(values, dtype=np.float64)
        met = self.mask
        blended = np.zeros((*met.shape, values.shape[1]))
        blended[met] = np.einsum(
            "nk,nkc->nc", self.barycentric[met], values[corners[self.face[met]]]
        )
        return blended


class Raycaster:
    """Answers rays against one mesh (world metres); both sides of a triangle are met."""

    def __init__(self, mesh: Mesh) -> None:
        import open3d as o3d

        self.mesh = mesh
        self._centre = mesh.bounds.mean(axis=0)
        self._tensor: Any = o3d.core.Tensor
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor((mesh.vertices - self._centre).astype(np.float32)),
            self._tensor(mesh.faces.astype(np.uint32)),
        )
        self._used = mesh.vertices[np.unique(mesh.faces)]
        self._normals: Floats | None = None

    def cast(self, camera: Camera, side: Side = "near") -> Hits:
        """What every pixel's central ray meets; only the mesh's own window is cast.

        Depth (H, W) is in metres along the camera's optical axis for both sides.
        """
        return self._cast_near(camera) if side == "near" else self._cast_far(camera)

    def _cast_near(self, camera: Camera) -> Hits:
        hits = Hits.nothing(camera)
        for rows, columns, rays in self._bands(camera):
            answer = self._scene.cast_rays(rays)
            # Directions have unit depth, so the ray's parameter is the depth itself.
            hits.fill((rows, columns), answer["t_hit"].numpy(), answer)
        return hits

    def _cast_far(self, camera: Camera) -> Hits:
        hits = Hits.nothing(camera)
        window = self.window(camera)
        if window.is_empty:
            return hits
        rows, columns = window.slices
        pixels = camera.pixel_centres()[rows, columns].reshape(-1, 2)
        directions = camera.ray_directions(pixels)
        end_m = float(camera.project(self.mesh.vertices)[1].max()) + _BEHIND_M
        answer = self.answer(camera.ray_origins(pixels) + end_m * directions, -directions)
        t = answer["t_hit"].numpy().reshape(window.height, window.width)
        # Directions have unit depth, so the ray's parameter counts depth from its far end.
        hits.fill((rows, columns), end_m - t, answer)
        return hits

    def depth(self, camera: Camera) -> Floats:
        """(H, W) metres along the optical axis; NaN where nothing is met."""
        return self.cast(camera).depth

    def mask(self, camera: Camera) -> NDArray[np.bool_]:
        """(H, W) whether the mesh is met at each pixel's centre."""
        covered = np.zeros((camera.height, camera.width), dtype=bool)
        for rows, columns, rays in self._bands(camera):
            covered[rows, columns] = self._scene.test_occlusions(rays).numpy()
        return covered

    def coverage(self, camera: Camera, *, supersample: int = 4) -> Floats:
        """(H, W) share of each pixel's square that the mesh covers.

        Measured with ``supersample * supersample`` rays a pixel.
        """
        width, height = camera.width, camera.height
        fine = self.mask(camera.resized(width * supersample, height * supersample))
        blocks = fine.reshape(height, supersample, width, supersample)
        return blocks.mean(axis=(1, 3))

    def normals(self, camera: Camera, side: Side = "near", *, frame: Frame = "camera") -> Floats:
        """(H, W, 3) unit smooth normals where the mesh is met, 0 elsewhere.

        Vertex normals blended over the triangle. They point out of the mesh, towards the viewer on
        the near side and away on the far side, and are not turned where it is wound inside out.

        Args:
            camera: The view.
            side: Which surface along the rays.
            frame: ``world``, or ``camera`` for maps: x right, y up, z towards the viewer.
        """
        return self.normals_at(self.cast(camera, side), camera, frame)

    def normals_at(self, hits: Hits, camera: Camera, frame: Frame = "camera") -> Floats:
        """As ``normals``, of rays that were cast already."""
        if self._normals is None:
            self._normals = vertex_normals(self.mesh)
        normals_world = hits.interpolate(self._normals, self.mesh.faces)
        length = np.linalg.norm(normals_world, axis=2, keepdims=True)
        normals_world /= np.where(length > 0, length, 1.0)
        return normals_world if frame == "world" else to_map_frame(normals_world, camera)

    def meets(self, pixels: ArrayLike, camera: Camera) -> NDArray[np.bool_]:
        """(N,) whether the rays through pixel coordinates (N, 2) meet the mesh."""
        rays = self._rays_from(camera.ray_origins(pixels), camera.ray_directions(pixels))
        return self._scene.test_occlusions(rays).numpy()

    def visible(
        self, points_world: ArrayLike, camera: Camera, *, tolerance_m: float
    ) -> NDArray[np.bool_]:
        """(N,) whether points (N, 3), world metres, are in the frame with nothing before them.

        Args:
            points_world: Usually on the surface itself.
            camera: The view.
            tolerance_m: How far behind the first hit a point may lie along its ray, metres; a
                point on the surface needs a little, and more where rays graze it.
        """
        points = np.asarray(points_world, dtype=np.float64)
        pixels, _ = camera.project(points)
        with np.errstate(invalid="ignore"):  # behind the camera: NaN, so not inside
            inside = ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=1)
        eyes = camera.eye_of(points[inside])
        toward = points[inside] - eyes
        t = self.answer(eyes, toward)["t_hit"].numpy()
        distance = np.linalg.norm(toward, axis=1)
        seen = np.zeros(len(points), dtype=bool)
        seen[inside] = (1.0 - t) * distance <= tolerance_m
        return seen

    def answer(self, origins_world: Floats, directions_world: Floats) -> Any:
        """Open3D's answer to rays (N, 3), (N, 3) from anywhere, world metres."""
        return self._scene.cast_rays(self._rays_from(origins_world, directions_world))

    def blocked(self, origins_world: Floats, directions_world: Floats) -> NDArray[np.bool_]:
        """(N,) whether rays (N, 3), (N, 3) from anywhere, world metres, meet the mesh at all."""
        rays = self._rays_from(origins_world, directions_world)
        return self._scene.test_occlusions(rays).numpy()

    def _rays_from(self, origins_world: Floats, directions_world: Floats) -> Any:
        rays = np.concatenate([origins_world - self._centre, directions_world], axis=1)
        return self._tensor(rays.astype(np.float32))

    def window(self, camera: Camera) -> Window:
        """The window of pixels in which the mesh lies."""
        return Window.around_points(self._used, camera)

    def is_cut(self, camera: Camera) -> bool:
        """Whether the mesh reaches beyond the camera's frame, or behind the camera."""
        return is_cut(self._used, camera)

    def _bands(self, camera: Camera) -> Iterator[tuple[slice, slice, Any]]:
        """Row and column slices with their (h, w, 6) rays, covering the mesh's window."""
        window = self.window(camera)
        if window.is_empty:
            return
        _, columns = window.slices
        x = np.arange(columns.start, columns.stop) + 0.5
        step = max(1, _BATCH // window.width)
        for top in range(window.top, window.bottom, step):
            rows = slice(top, min(top + step, window.bottom))
            y = np.arange(rows.start, rows.stop) + 0.5
            pixels = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
            rays = np.empty((len(y), len(x), 6), dtype=np.float32)
            flat = rays.reshape(-1, 6)
            flat[:, :3] = camera.ray_origins(pixels) - self._centre
            flat[:, 3:] = camera.ray_directions(pixels)
            yield rows, columns, self._tensor(rays)


def to_map_frame(normals_world: Floats, camera: Camera) -> Floats:
    """(..., 3) world normals in the frame of maps: x right, y up, z towards the viewer."""
    return normals_world @ (OPENCV_TO_BLENDER_CAMERA[:3, :3] @ camera.rotation).T
