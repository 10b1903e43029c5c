"""A figure of ellipsoids with limbs and a grain that fills space, photographed by known cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.core.arrays import Floats
from harness.core.camera import Camera, look_at
from harness.core.mesh import Mesh
from harness.geometry.outline import isosurface
from harness.geometry.raycast import Raycaster
from methods.body.photos.detection import Detections
from methods.cameras.values import PhotoView
from tests.unit.methods.stereo.conftest import grain

_STEP_M = 0.016
#: Ends and radii of the limbs, metres; no side is like the other.
_LIMBS = np.array(
    [
        # x, y, z to x, y, z, radius
        [0.00, 0.00, 0.00, 0.00, 0.45, 0.00, 0.15],
        [0.00, 0.62, 0.02, 0.02, 0.72, 0.04, 0.10],
        [0.18, 0.46, 0.00, 0.42, 0.10, 0.10, 0.055],
        [-0.18, 0.46, 0.00, -0.45, 0.22, 0.18, 0.055],
        [0.42, 0.10, 0.10, 0.48, -0.05, 0.22, 0.045],
        [-0.45, 0.22, 0.18, -0.40, 0.12, 0.34, 0.045],
        [0.10, -0.05, 0.00, 0.17, -0.80, 0.02, 0.08],
        [-0.10, -0.05, 0.00, -0.22, -0.80, -0.08, 0.08],
        [0.17, -0.82, 0.02, 0.19, -0.82, 0.16, 0.05],
        [-0.22, -0.82, -0.08, -0.26, -0.82, 0.05, 0.05],
        [0.10, 0.25, -0.16, -0.05, 0.10, -0.20, 0.09],
    ]
)


def figure() -> Mesh:
    """About 1.7 m high, closed, facing +Z."""
    low, high = np.array([-0.65, -0.95, -0.45]), np.array([0.7, 0.9, 0.6])
    axes = [np.arange(a, b, _STEP_M) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    depth = np.full(points.shape[:3], -np.inf)
    for *ends, radius in _LIMBS:
        start, way = np.array(ends[:3]), np.array(ends[3:]) - np.array(ends[:3])
        along = np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
        off = np.linalg.norm(points - start - along[..., None] * way, axis=-1)
        depth = np.maximum(depth, radius - off)
    return isosurface(
        depth.astype(np.float32), outside=-1.0, origin=low, step=_STEP_M, source="figure"
    )


def around(count: int, size: tuple[int, int], seed: int) -> tuple[Camera, ...]:
    """Cameras at uneven angles, heights, distances and rolls, all round."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.8, 1.25, count)
    yaws = np.cumsum(2 * np.pi * steps / steps.sum()) + rng.uniform(0, 6.28)
    found = []
    for yaw in yaws:
        pitch, roll = np.radians(rng.uniform(-10, 10)), np.radians(rng.uniform(-3, 3))
        way = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        up = (np.cos(yaw) * np.sin(roll), np.cos(roll), -np.sin(yaw) * np.sin(roll))
        pose = look_at(rng.uniform(2.8, 3.6) * way, rng.uniform(-0.04, 0.04, 3), up)
        K = np.diag([1.35 * size[1], 1.35 * size[1], 1.0])
        K[:2, 2] = size[0] / 2, size[1] / 2
        found.append(Camera(K, pose, *size))
    return tuple(found)


def photographed(mesh: Mesh, cameras: tuple[Camera, ...]) -> tuple[PhotoView, ...]:
    """Exact photos, each pixel the mean of nine."""
    caster = Raycaster(mesh)
    photos = []
    for number, camera in enumerate(cameras):
        fine = camera.resized(3 * camera.width, 3 * camera.height)
        hits = caster.cast(fine)
        corners = mesh.vertices[mesh.faces[hits.face[hits.mask]]]
        points = np.einsum("nk,nkc->nc", hits.barycentric[hits.mask].astype(float), corners)
        grey = np.zeros(hits.mask.shape)
        grey[hits.mask] = np.clip(grain(points), 0, 255)
        blocks = (camera.height, 3, camera.width, 3)
        share = hits.mask.reshape(blocks).mean(axis=(1, 3))
        shown = grey.reshape(blocks).mean(axis=(1, 3)) / np.maximum(share, 1e-9)
        rgba = np.stack([shown] * 3 + [255 * share], axis=-1)
        photos.append(PhotoView(f"{number}.png", np.round(rgba).astype(np.uint8)))
    return tuple(photos)


def landmarks() -> Floats:
    """(33, 3) of the figure's body, in its world."""
    body = np.zeros((33, 3))
    body[:11] = [0.0, 0.68, 0.08] + 0.03 * np.random.default_rng(1).normal(size=(11, 3))
    body[11:33:2, 0], body[12:33:2, 0] = 0.18, -0.18
    for left, place in {
        11: (0.18, 0.45, 0.0), 13: (0.3, 0.28, 0.05), 15: (0.42, 0.1, 0.1), 17: (0.45, 0.0, 0.18),
        19: (0.47, -0.03, 0.2), 21: (0.44, 0.02, 0.2), 23: (0.1, 0.0, 0.0), 25: (0.13, -0.4, 0.0),
        27: (0.17, -0.8, 0.02), 29: (0.17, -0.84, -0.02), 31: (0.19, -0.84, 0.16),
    }.items():  # fmt: skip
        body[left], body[left + 1] = place, np.array(place) * (-1, 1, 1)
    body[[14, 16, 18, 20, 22]] = [
        [-0.32, 0.34, 0.09], [-0.45, 0.22, 0.18], [-0.42, 0.15, 0.28], [-0.4, 0.12, 0.32],
        [-0.41, 0.16, 0.3],
    ]  # fmt: skip
    return body


def marks(cameras: tuple[Camera, ...], seed: int, off_m: float = 0.03) -> Detections:
    """Landmarks as a detector gives them: off by centimetres, and turned by some degrees."""
    rng, body = np.random.default_rng(seed), landmarks()
    pixels, points = [], []
    for camera in cameras:
        seen = body + rng.normal(0, off_m, body.shape)
        pixels.append(camera.project(seen)[0])
        turn = Rotation.from_rotvec(rng.normal(0, 0.08, 3)).as_matrix() @ camera.rotation
        points.append((body + rng.normal(0, off_m, body.shape) - body[[23, 24]].mean(0)) @ turn.T)
    confidence = np.full((len(cameras), 33), 0.9)
    return Detections(np.stack(pixels), np.stack(points), confidence, np.ones((len(cameras), 2)))


def turned(cameras: tuple[Camera, ...], most_deg: float, seed: int) -> tuple[Camera, ...]:
    """Cameras led round the figure, and tilted, by up to so many degrees."""
    rng = np.random.default_rng(seed)
    found = []
    for camera in cameras:
        pose = camera.world_to_camera.copy()
        turn = np.eye(4)
        axis = rng.normal(size=3)
        turn[:3, :3] = Rotation.from_rotvec(
            np.radians(rng.uniform(0, most_deg)) * axis / np.linalg.norm(axis)
        ).as_matrix()
        found.append(replace(camera, world_to_camera=pose @ turn))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """A figure and what eight cameras show of it."""

    mesh: Mesh
    cameras: tuple[Camera, ...]
    photos: tuple[PhotoView, ...]
    marks: Detections

    @property
    def height_m(self) -> float:
        return float(self.mesh.extent[1])


@pytest.fixture(scope="session")
def taken() -> Taken:
    mesh, cameras = figure(), around(8, (300, 480), 3)
    return Taken(mesh, cameras, photographed(mesh, cameras), marks(cameras, 5))


def errors_deg(found: tuple[Camera | None, ...], known: tuple[Camera, ...]) -> Floats:
    """(C,) rotations by which cameras differ, after the similarity that fits them best."""
    from harness.geometry.similarity import camera_similarity

    both = [(a, b) for a, b in zip(found, known, strict=True) if a is not None]
    move = camera_similarity(*zip(*both, strict=True)).similarity
    off = [move.camera(a).rotation @ b.rotation.T for a, b in both]
    return np.degrees(Rotation.from_matrix(np.stack(off)).magnitude())
