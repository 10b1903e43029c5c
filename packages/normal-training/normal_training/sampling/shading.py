"""What leaves a subject's surface towards a camera, each kind of light by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.camera import Camera
from harness.geometry.occlusion import lit_share
from harness.geometry.photo import texture_at
from harness.geometry.raycast import Raycaster
from normal_training.learning.variations.light import Gloss, Lamp, Light, sky_and_ground


@dataclass(frozen=True, slots=True, eq=False)
class Shading:
    """The N places where the rays of a fine camera meet the subject.

    Attributes:
        mask: (H, W) which rays meet it; places are in its order.
        albedo: (N, 3) linear colour of the surface.
        lights: (N, 2 + L) how much of the light of the sky, of the ground and of each lamp arrives.
        mirrored: (N, L) how much of each lamp's light is reflected as from a mirror.
    """

    mask: Mask
    albedo: Floats
    lights: Floats
    mirrored: Floats

    def radiance(self, light: Light) -> Floats:
        """(N, 3) linear light that leaves each place towards the camera.

        Args:
            light: Its lamps are the first ones of ``lights``.
        """
        count = 2 + len(light.lamps)
        diffuse = self.albedo * (self.lights[:, :count] @ light.colours)
        return diffuse + self.mirrored[:, : count - 2] @ light.colours[2:]


def shaded(
    caster: Raycaster,
    openness: Floats,
    camera: Camera,
    texture: Floats,
    lamps: Sequence[Lamp],
    gloss: Gloss,
) -> Shading:
    """What arrives where the rays of a camera meet a subject.

    Args:
        caster: Rays against the subject, which has texture coordinates.
        openness: (V, 1) share of the sky that each vertex sees.
        camera: With a ray through the middle of each pixel.
        texture: (h, w, 3) linear.
        lamps: Those of the light first.
        gloss: How the surface shines.
    """
    hits = caster.cast(camera)
    mesh = caster.mesh
    normals = caster.normals_at(hits, camera, "world")[hits.mask]
    rows, columns = np.nonzero(hits.mask)
    pixels = np.stack([columns, rows], axis=1) + 0.5
    points = camera.unproject(pixels, hits.depth[hits.mask])
    toward_camera = camera.position - points
    toward_camera /= np.linalg.norm(toward_camera, axis=1, keepdims=True)
    is_open = hits.interpolate(openness, mesh.faces)[hits.mask]
    lights = [sky_and_ground(normals) * is_open]
    mirrored = np.zeros((len(points), len(lamps)))
    for number, lamp in enumerate(lamps):
        toward = lamp.points.mean(axis=0) - points
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        facing = np.maximum((normals * toward).sum(axis=1), 0.0)
        lit = np.flatnonzero(facing > 0)
        facing[lit] *= lit_share(caster, points[lit], normals[lit], lamp.points)
        lights.append(facing[:, None])
        if gloss.strength > 0:
            mirrored[:, number] = gloss.share(normals, toward, toward_camera) * facing
    return Shading(
        mask=hits.mask,
        albedo=texture_at(hits, mesh, texture)[hits.mask],
        lights=np.concatenate(lights, axis=1),
        mirrored=mirrored,
    )


def averaged(values: Floats, mask: Mask, rays: int) -> tuple[Floats, Floats]:
    """Values of rays, averaged over those of each pixel that meet the subject, and their share.

    Args:
        values: (N, C) at the places of ``mask``.
        mask: (H * rays, W * rays) which rays meet the subject.
        rays: Rays along each side of a pixel.

    Returns:
        (H, W, C), 0 where no ray meets it, and the share (H, W) of rays that do.
    """
    height, width = mask.shape[0] // rays, mask.shape[1] // rays
    blocks = (height, rays, width, rays)
    coverage = mask.reshape(blocks).mean(axis=(1, 3))
    spread = np.zeros((*mask.shape, values.shape[1]))
    spread[mask] = values
    total = spread.reshape(*blocks, -1).mean(axis=(1, 3))
    return total / np.where(coverage > 0, coverage, 1.0)[..., None], coverage
