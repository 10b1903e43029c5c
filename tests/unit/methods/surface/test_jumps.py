"""Maps with strong occlusion edges: as good as the published iteration, written plainly.

Depth is known everywhere: objects in front of each other, limbs before a trunk, folds that cross,
and a body seen from the side with its arms before it. Where surfaces hide each other the
integration has many minima, and any other way to one of them gives another surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.ndimage import label

from harness.core.arrays import Floats, Mask
from harness.core.mesh import Mesh
from harness.core.rigs import RingRig
from harness.geometry.raycast import Raycaster
from methods.surface import integrate_normals
from tests.plain_integration import plain_integration

SIZE = 140
K = np.array([[2.2 * SIZE, 0, SIZE / 2], [0, 2.2 * SIZE, SIZE / 2], [0, 0, 1]])
#: Of the plain way's error.
MOST = 1.02


@dataclass(frozen=True)
class Map:
    """Normals (H, W, 3) in the map frame, depth along the axis and mask of one view."""

    normals: Floats
    depth: Floats
    mask: Mask
    K: Floats


class Scene:
    """Surfaces in front of each other, each a depth that is a function of the ray."""

    def __init__(self) -> None:
        x, y = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
        self.rays = np.stack(
            [(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], -1
        )
        self.depth = np.full((SIZE, SIZE), np.inf)
        self.normals = np.zeros((SIZE, SIZE, 3))

    def ellipsoid(self, centre, radii) -> Scene:
        """Adds one, with radii along x, y and z, metres."""
        shape, centre = 1 / np.square(radii), np.asarray(centre)
        a = (self.rays**2 * shape).sum(axis=-1)
        b, c = (self.rays * shape) @ centre, (centre**2 * shape).sum() - 1
        hit = b * b > a * c
        near = np.where(hit, (b - np.sqrt(np.where(hit, b * b - a * c, 0.0))) / a, np.inf)
        normals = (near[..., None] * self.rays - centre) * shape
        return self._added(near, normals)

    def sheet(self, depth: float, wave: Floats, height: float, length: float) -> Scene:
        """Adds folds: depth + height sin(wave . (x, y) / length), solved along each ray."""
        z = np.full((SIZE, SIZE), depth)
        for _ in range(30):
            phase = ((z[..., None] * self.rays)[..., :2] @ wave) / length
            z = depth + height * np.sin(phase)
        slope = height * np.cos(phase)[..., None] * wave / length
        normals = np.concatenate([slope, -np.ones((SIZE, SIZE, 1))], axis=-1)
        return self._added(z, normals)

    def _added(self, depth: Floats, normals: Floats) -> Scene:
        first = depth < self.depth
        self.depth[first], self.normals[first] = depth[first], normals[first]
        return self

    def map(self, within: Mask | None = None) -> Map:
        mask = np.isfinite(self.depth) if within is None else np.isfinite(self.depth) & within
        parts = label(mask)[0]
        # Parts that do not touch tell nothing of each other.
        mask = parts == 1 + np.bincount(parts.ravel())[1:].argmax()
        with np.errstate(invalid="ignore"):
            unit = self.normals / np.linalg.norm(self.normals, axis=-1, keepdims=True)
        return Map(np.where(mask[..., None], unit * (1.0, -1.0, -1.0), 0.0), self.depth, mask, K)


def objects(seed: int) -> Map:
    """Five ellipsoids that hide parts of each other."""
    rng, scene = np.random.default_rng(seed), Scene()
    for _ in range(5):
        centre = np.append(rng.uniform(-0.35, 0.35, 2), rng.uniform(2.4, 3.6))
        scene.ellipsoid(centre, rng.uniform(0.15, 0.4, 3))
    return scene.map()


def limbs(lift_m: float) -> Map:
    """A trunk with two long limbs before it, clear of it by about ``lift_m``."""
    scene = Scene().ellipsoid((0, 0, 3), (0.3, 0.6, 0.2))
    scene.ellipsoid((-0.1, 0.05, 2.75 - lift_m), (0.06, 0.4, 0.06))
    return scene.ellipsoid((0.15, -0.1, 2.75 - lift_m), (0.3, 0.055, 0.06)).map()


def crossing_folds() -> Map:
    """One folded sheet before another, its edge cut like a hem."""
    back, front = Scene(), Scene()
    back.sheet(3.0, np.array([1.0, 0.4]), 0.02, 0.03)
    front.sheet(2.9, np.array([0.3, -1.0]), 0.025, 0.035)
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    above = y < 0.5 + 0.06 * np.sin(14 * x)
    back.depth[above], back.normals[above] = front.depth[above], front.normals[above]
    return back.map(np.hypot(x - 0.5, y - 0.5) < 0.46)


def body_from_the_side(yaw_deg: float) -> Map:
    """A body model's arms and legs before its trunk."""
    import torch

    from methods.body.models.anny_body import AnnyBody
    from methods.body.models.model import neutral

    body = AnnyBody()
    with torch.no_grad():
        vertices = body.posed(neutral(body)).vertices[0].double().numpy()
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    camera = RingRig(views=8, first_yaw_deg=yaw_deg).cameras(180, 320)[0]
    caster = Raycaster(Mesh(vertices - middle, body.faces))
    hits = caster.cast(camera)
    return Map(caster.normals(camera), hits.depth, hits.mask, camera.K)


MAPS = {
    "objects 0": lambda: objects(0),
    "objects 1": lambda: objects(1),
    "objects 2": lambda: objects(2),
    "limbs near": lambda: limbs(0.05),
    "limbs far": lambda: limbs(0.5),
    "crossing folds": crossing_folds,
    "body, three quarters": lambda: body_from_the_side(45.0),
    "body, side": lambda: body_from_the_side(90.0),
}


def error_m(depth: Floats, view: Map) -> float:
    """Mean distance along the axis, at the scale that fits best; normals do not tell it."""
    scale = np.median(view.depth[view.mask] / depth[view.mask])
    return float(np.abs(scale * depth - view.depth)[view.mask].mean())


@pytest.mark.nightly
@pytest.mark.parametrize("name", MAPS)
def test_as_good_as_the_published_iteration_where_surfaces_hide_each_other(name: str) -> None:
    view = MAPS[name]()
    assert view.mask.sum() > 2000
    plain = error_m(plain_integration(view.normals, view.mask, view.K), view)
    ours = error_m(integrate_normals(view.normals, view.mask, view.K), view)
    assert ours <= MOST * plain, f"{1e3 * ours:.3f} mm against {1e3 * plain:.3f} mm"
