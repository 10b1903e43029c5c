"""A renderer without Blender: first hits, textured Lambert shading, no shadows.

For tests, previews and machines without Blender; ``renderers/capture.py`` has the light.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import image_name
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.process.threads import StepReport
from harness.core.settings import RenderRecipe
from harness.geometry.images import load_rgb, save_png, srgb_from_linear
from harness.geometry.photo import linear_texture, texture_at
from harness.geometry.raycast import Hits, Raycaster
from renderers.capture import key_light_position
from renderers.protocol import RenderOutcome, texture_of

#: Rays along each side of a pixel. Odd, so that half-covered pixels do not tie.
_SUPERSAMPLE = 3


class RaycastRenderer:
    """Casts nine rays per pixel with Open3D; samples, denoiser and seed have no effect."""

    def render(
        self, mesh: Mesh, recipe: RenderRecipe, directory: Path, progress: StepReport
    ) -> RenderOutcome:
        """See ``Renderer.render``."""
        texture = linear_texture(load_rgb(texture_of(mesh)))
        caster = Raycaster(mesh)
        cameras = recipe.cameras()
        for view, camera in enumerate(cameras):
            save_png(directory / image_name(view), _picture(caster, texture, camera, recipe))
            progress(view + 1, len(cameras))
        return RenderOutcome(device="CPU")


def _picture(
    caster: Raycaster, texture: Floats, camera: Camera, recipe: RenderRecipe
) -> NDArray[np.uint8]:
    """(H, W, 4) uint8 picture; only the window around the mesh is ray-cast and shaded."""
    picture = np.zeros((camera.height, camera.width, 4), dtype=np.uint8)
    window = caster.window(camera)
    if window.is_empty:
        return picture
    fine = window.camera(camera, (window.width * _SUPERSAMPLE, window.height * _SUPERSAMPLE))
    hits = caster.cast(fine)
    colour = texture_at(hits, caster.mesh, texture) * _light(hits, caster, fine, recipe)[..., None]
    blocks = (window.height, _SUPERSAMPLE, window.width, _SUPERSAMPLE)
    alpha = hits.mask.reshape(blocks).mean(axis=(1, 3))[..., None]
    premultiplied = colour.reshape(*blocks, 3).mean(axis=(1, 3))
    straight = premultiplied / np.where(alpha > 0, alpha, 1.0)
    rgba = np.concatenate([srgb_from_linear(np.clip(straight, 0, 1)), alpha], axis=2)
    picture[window.slices] = np.round(rgba * 255).astype(np.uint8)
    return picture


def _light(hits: Hits, caster: Raycaster, camera: Camera, recipe: RenderRecipe) -> Floats:
    """(H, W) light that reaches each hit: even light and key light, both sides lit alike."""
    normals_world = caster.normals_at(hits, camera, "world")
    view = camera.ray_directions(camera.pixel_centres().reshape(-1, 2)).reshape(normals_world.shape)
    away = (normals_world * view).sum(axis=2) > 0
    normals_world[away] *= -1
    toward_key = key_light_position(camera)
    facing = np.maximum(normals_world @ (toward_key / np.linalg.norm(toward_key)), 0.0)
    return recipe.light_strength + recipe.key_light_strength * facing
