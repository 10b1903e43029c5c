"""Solids with a texture that fills space, photographed exactly; depth and normals are known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from harness.core.arrays import Bytes, Floats
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.raycast import Raycaster
from methods.stereo.views import StereoView, stereo_view
from tests.spheres import icosphere

#: A pixel spans 2.25 mm of the subject, as half the resolution of ``paper8`` does.
CAMERAS = RingRig(views=8).cameras(540, 960)
RADIUS = 0.15

Texture = Callable[[Floats], Floats]


def grain(points: Floats) -> Floats:
    """(N,) brightness of a texture that fills space: forty waves of 12 to 60 mm."""
    rng = np.random.default_rng(7)
    directions = rng.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    waves = directions * (2 * np.pi / rng.uniform(0.012, 0.06, (40, 1)))
    return 128.0 + 12.0 * np.sin(points @ waves.T + rng.uniform(0, 6.28, 40)).sum(axis=1)


def plain(points: Floats) -> Floats:
    """(N,) one brightness everywhere."""
    return np.full(len(points), 128.0)


def stripes(direction: tuple[float, float, float], wave_m: float) -> Texture:
    """Waves across ``direction``."""
    across = np.array(direction) * 2 * np.pi / wave_m
    return lambda points: 128.0 + 50.0 * np.sin(points @ across)


def picture(
    caster: Raycaster, camera: Camera, texture: Texture, noise: float, rng: np.random.Generator
) -> Bytes:
    """(H, W, 4) what an exact camera shows of a textured mesh, with noise in grey levels."""
    hits = caster.cast(camera)
    rgba = np.zeros((camera.height, camera.width, 4), np.uint8)
    corners = caster.mesh.vertices[caster.mesh.faces[hits.face[hits.mask]]]
    points = np.einsum("nk,nkc->nc", hits.barycentric[hits.mask].astype(float), corners)
    grey = texture(points) + (rng.normal(0.0, noise, len(points)) if noise else 0.0)
    rgba[hits.mask, :3] = np.clip(np.round(grey), 0, 255).astype(np.uint8)[:, None]
    rgba[hits.mask, 3] = 255
    return rgba


def photographs(
    mesh: Mesh, cameras: tuple[Camera, ...], texture: Texture, noise: float = 0.0, seed: int = 0
) -> list[StereoView]:
    """Pictures of all cameras, as stereo sees them."""
    caster, rng = Raycaster(mesh), np.random.default_rng(seed)
    return [stereo_view(each, picture(caster, each, texture, noise, rng)) for each in cameras]


def shaken(cameras: tuple[Camera, ...], error_px: float, seed: int) -> tuple[Camera, ...]:
    """Cameras turned so that what they see is off by about ``error_px``."""
    rng = np.random.default_rng(seed)
    turned = []
    for camera in cameras:
        across, along = rng.normal(0.0, error_px / camera.K[0, 0], 2)
        turned.append(camera.turned([[1, 0, across], [0, 1, along], [-across, -along, 1]]))
    return tuple(turned)


@pytest.fixture(scope="session")
def sphere() -> Mesh:
    """The truth: 15 cm of radius."""
    return icosphere(RADIUS)


@pytest.fixture(scope="session")
def around(sphere) -> Mesh:
    """A start that stands off by 2 cm."""
    return Mesh(sphere.vertices * (RADIUS + 0.02) / RADIUS, sphere.faces, source="start")


@pytest.fixture(scope="session")
def textured(sphere) -> list[StereoView]:
    """Eight photos of the grained sphere."""
    return photographs(sphere, CAMERAS, grain)
