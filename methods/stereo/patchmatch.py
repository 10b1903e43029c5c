"""A depth map of each view: PatchMatch with slanted planes between neighbouring photos.

Source: Bleyer, Rhemann and Rother, "PatchMatch stereo", BMVC 2011, with the red and black halves of
Galliani, Lasinger and Schindler, "Massively parallel multiview stereopsis", ICCV 2015. Every pixel
holds a plane; it tries depths around a start surface, then the planes of its neighbours and random
ones near its own, and keeps what correlates best with the views beside it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from harness.core.arrays import Floats, Ints, Ints32, Mask, Singles
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster
from methods.stereo.kernels import (
    Planes,
    Reference,
    Sources,
    Turn,
    device_array,
    launch,
    match_first,
    match_round,
    match_sharpness,
    quads,
)
from methods.stereo.membrane import Neighbourhood
from methods.stereo.settings import MatchSettings
from methods.stereo.views import OUTSIDE, Contrast

#: A view is asked about a point that it sees at no flatter angle, and is not blocked from there.
_LEAST_FACING, _LIFT_M = 0.2, 0.006
#: How often the start's normals are averaged over their neighbours: PatchMatch finds the detail.
_SMOOTHINGS = 6
#: Width of the windows' weights, over half the window.
_SPREAD = 0.7
_NO_COST = 2.0
#: Eight bits cannot show less contrast.
_LEAST_CONTRAST = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class DepthMap:
    """What one view found.

    Attributes:
        camera: Whose pixels these are.
        depth: (H, W) metres along the optical axis.
        normal: (H, W, 3) unit, in the camera's axes (OpenCV), towards the camera.
        cost: (H, W) 1 minus the correlation.
        sharpness: (H, W) by how much the cost rises a little before and behind.
        searched: (H, W) where the start is seen by this and by another view.
        sources: The views it was matched with.
        witnesses: (S, H, W) which of these sees each pixel's point of the start surface.
    """

    camera: Camera
    depth: Singles
    normal: Singles
    cost: Singles
    sharpness: Singles
    searched: Mask
    sources: tuple[int, ...]
    witnesses: Mask


class StartSurface:
    """A mesh around which depths are searched, with smooth normals.

    Args:
        mesh: Closed, facing outwards, world metres.
        within: Which of its places (N, 3) are searched; all of them unless given.
    """

    def __init__(self, mesh: Mesh, within: Callable[[Floats], Mask] | None = None) -> None:
        self.mesh = mesh
        self.caster = Raycaster(mesh)
        self.normals = Neighbourhood(mesh).smooth_normals(_SMOOTHINGS)
        self.within = within


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What the start surface shows to one view: per pixel (N,) of those that are searched."""

    rows: Ints
    columns: Ints
    depth: Floats
    normal_camera: Floats
    visible: Mask


def window_weights(radius: int, spread: float = _SPREAD) -> Singles:
    """(2r + 1, 2r + 1) Gaussian weights of a window's samples, ``spread`` times the radius wide."""
    way = np.arange(-radius, radius + 1)
    square = (way**2)[:, None] + (way**2)[None]
    return np.exp(-0.5 * square / (spread * radius) ** 2).astype(np.float32)


def depth_map(
    view: int,
    photos: Sequence[Contrast],
    sources: tuple[int, ...],
    start: StartSurface,
    settings: MatchSettings,
) -> DepthMap | None:
    """The depth map of one view, or None where no other view sees what it sees.

    Args:
        view: Whose map.
        photos: Photos of all views.
        sources: The views it is matched with.
        start: The surface around which depths are searched.
        settings: How.
    """
    photo = photos[view]
    others = [photos[source] for source in sources]
    seen = _seen(photo, [other.camera for other in others], start)
    if len(seen.rows) == 0:
        return None
    shape = photo.values.shape
    depth = np.zeros(shape, np.float32)
    depth[seen.rows, seen.columns] = seen.depth
    normal = np.zeros((*shape, 3), np.float32)
    normal[seen.rows, seen.columns] = seen.normal_camera
    visible = np.zeros((len(sources), *shape), np.int32)
    visible[:, seen.rows, seen.columns] = seen.visible
    planes = Planes()
    planes.depth = device_array(depth, wp.float32)
    planes.normal = device_array(normal, wp.vec3)
    planes.cost = device_array(np.full(shape, _NO_COST), wp.float32)
    reference = _reference(photo, depth, normal, settings)
    matched = _sources(photo, others, visible)
    pixels = device_array(np.stack([seen.columns, seen.rows], axis=1), wp.vec2i)
    count, seed = len(seen.rows), settings.seed * 1000 + view
    launch(match_first, count, [reference, matched, planes, pixels, settings.tries, seed])
    for number in range(settings.rounds):
        for colour in (0, 1):
            turn = _turn(number, colour, seed)
            launch(match_round, count, [reference, matched, planes, pixels, turn])
    sharpness = device_array(np.zeros(shape), wp.float32)
    launch(
        match_sharpness, count, [reference, matched, planes, pixels, settings.aside_m, sharpness]
    )
    searched = np.zeros(shape, dtype=bool)
    searched[seen.rows, seen.columns] = True
    return DepthMap(
        camera=photo.camera,
        depth=planes.depth.numpy(),
        normal=planes.normal.numpy(),
        cost=planes.cost.numpy(),
        sharpness=sharpness.numpy(),
        searched=searched,
        sources=sources,
        witnesses=visible > 0,
    )


def _seen(photo: Contrast, cameras: Sequence[Camera], start: StartSurface) -> _Seen:
    """The start surface's pixels in a photo that at least one of the other cameras sees too."""
    hits = start.caster.cast(photo.camera)
    rows, columns = np.nonzero(hits.mask & photo.mask)
    if start.within is not None:
        pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
        asked = start.within(photo.camera.unproject(pixels, hits.depth[rows, columns]))
        rows, columns = rows[asked], columns[asked]
    corners = start.mesh.faces[hits.face[rows, columns]]
    weights = hits.barycentric[rows, columns].astype(np.float64)
    normal = np.einsum("nk,nkc->nc", weights, start.normals[corners])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    depth = hits.depth[rows, columns]
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
    points = photo.camera.unproject(pixels, depth)
    own = _facing(points, normal, photo.camera)[0] > _LEAST_FACING
    visible = np.zeros((len(cameras), len(rows)), dtype=bool)
    for index, camera in enumerate(cameras):
        facing, toward = _facing(points, normal, camera)
        asked = np.flatnonzero(own & (facing > _LEAST_FACING))
        blocked = start.caster.blocked(points[asked] + _LIFT_M * normal[asked], toward[asked])
        visible[index, asked[~blocked]] = True
    used = visible.any(axis=0)
    in_camera = normal[used] @ photo.camera.rotation.T
    return _Seen(rows[used], columns[used], depth[used], in_camera, visible[:, used])


def _facing(points: Floats, normals: Floats, camera: Camera) -> tuple[Floats, Floats]:
    """(N,) cosines between normals and the directions (N, 3) to a camera, and these."""
    toward = camera.eye_of(points) - points
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    return np.einsum("ij,ij->i", toward, normals), toward


def _reference(photo: Contrast, depth: Singles, normal: Singles, settings: MatchSettings) -> Any:
    reference = Reference()
    # With a border, so that no window reaches beyond the picture.
    bordered = np.pad(photo.values, settings.radius_px, constant_values=OUTSIDE)
    reference.image = device_array(bordered, wp.float32)
    reference.back = wp.mat33(_back(photo.camera).astype(np.float32))
    reference.parallel = photo.camera.is_orthographic
    reference.floor = _floor(photo)
    reference.near = device_array(depth - settings.before_m, wp.float32)
    reference.far = device_array(depth + settings.behind_m, wp.float32)
    reference.prior = device_array(normal, wp.vec3)
    reference.weights = device_array(window_weights(settings.radius_px), wp.float32)
    reference.radius = settings.radius_px
    reference.best_share = settings.best_share
    return reference


def _turn(number: int, colour: int, seed: int) -> Any:
    """Half a round; the pixels five away, on one side and then on the other, carry planes far."""
    far = 5 * (1 - 2 * (number % 2))
    turn = Turn()
    turn.number, turn.colour, turn.seed = number, colour, seed
    steps = [(1, 0), (-1, 0), (0, 1), (0, -1), (far, 0), (0, far)]
    turn.steps = device_array(steps, wp.vec2i)
    return turn


def _sources(photo: Contrast, others: Sequence[Contrast], visible: Ints32) -> Any:
    height = max(other.values.shape[0] for other in others)
    width = max(other.values.shape[1] for other in others)
    images = np.full((len(others), height, width), OUTSIDE, np.float32)
    rotation, shift = np.zeros((len(others), 3, 3)), np.zeros((len(others), 3))
    back = _back(photo.camera)
    for index, other in enumerate(others):
        rows, columns = other.values.shape
        images[index, :rows, :columns] = other.values
        move = other.camera.world_to_camera @ photo.camera.camera_to_world
        if other.camera.is_orthographic:
            move[2] = 0.0, 0.0, 0.0, 1.0
        rotation[index] = other.camera.K @ move[:3, :3] @ back
        shift[index] = other.camera.K @ move[:3, 3]
        if photo.camera.is_orthographic:
            rotation[index, :, 2] += shift[index]
            shift[index] = other.camera.K @ move[:3, 2]
    sources = Sources()
    sources.quads = quads(images)
    sources.rotation = device_array(rotation, wp.mat33)
    sources.shift = device_array(shift, wp.vec3)
    sources.floor = device_array([_floor(other) for other in others], wp.float32)
    sources.visible = device_array(visible, wp.int32)
    return sources


def _back(camera: Camera) -> Floats:
    """(3, 3) from pixels to their rays in camera axes, or to where these start if parallel."""
    back = np.linalg.inv(camera.K)
    return np.diag([1.0, 1.0, 0.0]) @ back if camera.is_orthographic else back


def _floor(photo: Contrast) -> float:
    """The variance that a window has from noise alone: less texture than that tells nothing."""
    return max(photo.noise, _LEAST_CONTRAST) ** 2
