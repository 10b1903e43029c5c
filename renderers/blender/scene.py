"""A Blender scene as plain data: cameras, lights and settings, without Blender.

Everything that determines how the pictures look is here and can be tested without ``bpy``; the
worker only executes it. Blender's world has +Z up and its cameras look along their own -Z.

Before: ``harness/data/scans.py``. After: ``methods/hull.py``.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import image_name
from harness.core.camera import Camera, look_at
from harness.core.camera_frames import BLENDER_TO_WORLD, camera_to_blender
from harness.core.errors import DataError
from harness.core.files.hashing import derive_seed
from harness.core.mesh import Mesh
from harness.core.process.blender import find_blender
from harness.core.process.threads import StepReport
from harness.core.process.workers import run_worker
from harness.core.settings import RenderRecipe
from harness.geometry.images import load_rgba, save_png
from harness.geometry.window import Window
from renderers.capture import KEY_SIDE_M, key_light_position, square_light_radiance
from renderers.protocol import RenderOutcome, texture_of

_WORKER = "renderers.blender.worker"


class BlenderRenderer:
    """Path-traces with Blender's Cycles, on a GPU where there is one."""

    def render(
        self, mesh: Mesh, recipe: RenderRecipe, directory: Path, progress: StepReport
    ) -> RenderOutcome:
        """See ``Renderer.render``."""
        blender = find_blender()
        texture = texture_of(mesh)
        assert mesh.uv is not None
        assert mesh.face_uv is not None
        scene = describe(mesh, recipe)
        with tempfile.TemporaryDirectory(prefix="harness-render-") as folder:
            # Arrays instead of the scan's file, so that the checked mesh is the rendered one.
            arrays = Path(folder, "mesh.npz")
            np.savez(
                arrays,
                vertices=vertices_in_blender(mesh),
                faces=mesh.faces,
                corner_uv=mesh.uv[mesh.face_uv].astype(np.float32),
            )
            answer = run_worker(
                blender.worker(_WORKER),
                RenderJob(scene, arrays, texture.resolve(), Path(folder)),
                progress=progress,
            )
            for view in scene.views:
                # Decoded and written again: Blender stores its render times in its files,
                # so that files of equal pictures would differ.
                size = (scene.width, scene.height)
                save_png(directory / view.file, load_rgba(Path(folder, view.file), size))
        return RenderOutcome(device=str(answer["device"]))


Matrix = tuple[tuple[float, ...], ...]

#: Only lens / sensor matters, so any value would do; this is Blender's default.
_SENSOR_MM = 36.0
#: Margin around the subject, pixels, so that the denoiser sees the background.
_BORDER_MARGIN_PX = 8


@dataclass(frozen=True, slots=True)
class BlenderCamera:
    """A camera object's settings.

    Attributes:
        matrix_world: 4x4, Blender camera axes to Blender's world.
        lens_mm: Focal length for a sensor fitted to the picture's width.
        sensor_mm: Width of that sensor.
        shift_x: Offset of the principal point from the middle, as a share of the picture's width.
        shift_y: The same downward, also as a share of the width.
        width_m: What an orthographic picture's width spans, metres; 0 for a perspective one, whose
            lens counts.
    """

    matrix_world: Matrix
    lens_mm: float
    sensor_mm: float
    shift_x: float
    shift_y: float
    width_m: float = 0.0

    @classmethod
    def from_camera(cls, camera: Camera) -> BlenderCamera:
        """The Blender camera that has the same rays.

        Raises:
            DataError: pixels that are not square.
        """
        K = camera.K
        if not math.isclose(K[0, 0], K[1, 1], rel_tol=1e-9):
            raise DataError(
                "Blender cannot render this camera",
                expected="square pixels",
                got=f"fx {K[0, 0]}, fy {K[1, 1]}",
            )
        width, height = camera.width, camera.height
        return cls(
            matrix_world=_matrix(camera_to_blender(camera)),
            lens_mm=float(K[0, 0] * _SENSOR_MM / width),
            sensor_mm=_SENSOR_MM,
            # Our pixel (0.5, 0.5) is the first pixel's centre, so the middle is half the size.
            shift_x=float((width / 2 - K[0, 2]) / width),
            shift_y=float((K[1, 2] - height / 2) / width),
            width_m=float(width / K[0, 0]) if camera.is_orthographic else 0.0,
        )


@dataclass(frozen=True, slots=True)
class KeyLight:
    """A square area light, seen by the surface but not by the camera.

    Attributes:
        matrix_world: 4x4; it shines along its own -Z.
        side_m: Side length.
        power_w: What Blender calls power; the radiance of an area light is power / (pi * area).
    """

    matrix_world: Matrix
    side_m: float
    power_w: float


@dataclass(frozen=True, slots=True)
class BlenderView:
    """One picture.

    Attributes:
        file: Its path below the capture's folder.
        camera: The camera that takes it.
        key_light: The light that goes with the camera, or None.
        border: Left, bottom, right, top of the part that is rendered, as shares of the picture;
            the rest stays empty. None when the subject is outside.
        seed: Seed of the light paths.
    """

    file: str
    camera: BlenderCamera
    key_light: KeyLight | None
    border: tuple[float, float, float, float] | None
    seed: int


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything that the worker is given, apart from the mesh.

    Attributes:
        views: The pictures, in order.
        width: Pixels.
        height: Pixels.
        samples: Light paths per pixel. Every pixel gets all of them: adaptive
            sampling would leave alpha with fewer steps at the edges.
        denoise: Whether Open Image Denoise runs on colour; alpha is never denoised.
        ambient: Radiance of the uniform world.
        diffuse_bounces: Reflections of light between surfaces; without them folds are black.
    """

    views: tuple[BlenderView, ...]
    width: int
    height: int
    samples: int
    denoise: bool
    ambient: float
    diffuse_bounces: int = 2


@dataclass(frozen=True, slots=True)
class RenderJob:
    """A scene, and where its files lie.

    Attributes:
        scene: What is rendered.
        mesh: .npz with vertices in Blender's axes, faces, and texture coordinates by corner.
        texture: The picture on it.
        folder: Receives the pictures.
    """

    scene: Scene
    mesh: Path
    texture: Path
    folder: Path


def describe(mesh: Mesh, recipe: RenderRecipe) -> Scene:
    """The scene that photographs a mesh (world metres) by a recipe."""
    return Scene(
        views=tuple(
            BlenderView(
                file=image_name(view),
                camera=BlenderCamera.from_camera(camera),
                key_light=_key_light(camera, recipe.key_light_strength),
                border=_border(mesh, camera),
                seed=derive_seed(recipe.seed, "render", view) % 2**31,
            )
            for view, camera in enumerate(recipe.cameras())
        ),
        width=recipe.width,
        height=recipe.height,
        samples=recipe.samples,
        denoise=recipe.denoise,
        ambient=recipe.light_strength,
    )


def vertices_in_blender(mesh: Mesh) -> NDArray[np.float32]:
    """(V, 3) the mesh's vertices in Blender's world."""
    # The change of axes is a rotation, so its transpose undoes it.
    return (mesh.vertices @ BLENDER_TO_WORLD[:3, :3]).astype(np.float32)


def _key_light(camera: Camera, strength: float) -> KeyLight | None:
    if strength <= 0:
        return None
    position = key_light_position(camera)
    # A light shines in the direction in which a camera at its place would look.
    aim = Camera(K=np.eye(3), world_to_camera=look_at(position, (0, 0, 0)), width=1, height=1)
    radiance = square_light_radiance(strength, float(np.linalg.norm(position)))
    return KeyLight(
        matrix_world=_matrix(camera_to_blender(aim)),
        side_m=KEY_SIDE_M,
        power_w=radiance * math.pi * KEY_SIDE_M**2,
    )


def _border(mesh: Mesh, camera: Camera) -> tuple[float, float, float, float] | None:
    window = Window.around_points(mesh.vertices, camera, margin=_BORDER_MARGIN_PX)
    if window.is_empty:
        return None
    return (
        window.left / camera.width,
        1.0 - window.bottom / camera.height,
        window.right / camera.width,
        1.0 - window.top / camera.height,
    )


def _matrix(transform: Floats) -> Matrix:
    return tuple(tuple(float(number) for number in row) for row in transform)
