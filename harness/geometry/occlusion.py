"""What of its surroundings a surface sees, and what a photo shows of its vertices."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.images import sampled
from harness.geometry.outline import inner_depth_px
from harness.geometry.photo import Photo, linear_texture
from harness.geometry.raycast import Raycaster
from harness.geometry.surface import vertex_normals

#: Rays start this far above the surface, metres, so that they do not meet where they start.
_LIFT_M = 1e-3
_BATCH = 1 << 20
#: Directions from which a surface is looked at, and points of it that are tried for its share.
_DIRECTIONS, _SAMPLES = 128, 20_000
#: Where a face is tried: its middle; if it has more than this share of the area, its corners, too.
_PLACES = np.array([[2, 2, 2], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6.0
_LARGE = 1e-5
#: Rays leave a surface from this share of its size above it.
_LEAVE = 2e-5


def vertex_openness(caster: Raycaster, rays: int, seed: int) -> Floats:
    """(V,) share of even light from everywhere that reaches each vertex, 0 to 1.

    The cosine-weighted hemisphere above the surface, sampled by ``rays`` rays that are turned at
    random for each vertex. A convex surface is 1 everywhere.

    Args:
        caster: Rays against the surface.
        rays: Per vertex.
        seed: Seed of the random turns of the rays about each normal.
    """
    mesh = caster.mesh
    normals = vertex_normals(mesh)
    # The disc of Vogel's spiral, lifted: cosine-weighted directions, evenly spread.
    index = np.arange(rays) + 0.5
    radius, turn = np.sqrt(index / rays), index * np.pi * (3.0 - np.sqrt(5.0))
    height = np.sqrt(1.0 - radius**2)
    start = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(normals))
    across, along = _frames(normals)
    open_rays = np.zeros(len(normals))
    step = max(1, _BATCH // rays)
    for first in range(0, len(normals), step):
        rows = slice(first, first + step)
        angle = start[rows, None] + turn
        directions = (
            (radius * np.cos(angle))[..., None] * across[rows, None]
            + (radius * np.sin(angle))[..., None] * along[rows, None]
            + height[:, None] * normals[rows, None]
        )
        origins = mesh.vertices[rows, None] + _LIFT_M * normals[rows, None]
        free = _free(caster, np.broadcast_to(origins, directions.shape), directions)
        open_rays[rows] = free.mean(axis=1)
    return open_rays


def lit_share(caster: Raycaster, points: Floats, normals: Floats, lamp: Floats) -> Floats:
    """(N,) share of a lamp that points (N, 3) on the surface see, world metres.

    Args:
        caster: Rays against the surface.
        points: On it.
        normals: (N, 3) unit, out of it.
        lamp: (L, 3) points of the lamp.
    """
    origins = points + _LIFT_M * normals
    share = np.zeros(len(points))
    for place in lamp:
        share += _free(caster, origins, place - origins)
    return share / len(lamp)


def hidden_faces(mesh: Mesh) -> Mask:
    """(F,) which faces no ray from outside reaches on either side, as a body's under its clothes.

    Rays come from 128 directions: the bottom of a narrow fold may count as hidden.
    """
    caster, is_large = Raycaster(mesh), mesh.face_areas() > _LARGE * mesh.area
    hidden = np.ones(len(mesh.faces), dtype=bool)
    tried = np.arange(len(mesh.faces))
    for weights in _PLACES:
        points = np.einsum("k,fkc->fc", weights, mesh.vertices[mesh.faces[tried]])
        hidden[tried] = _are_hidden(caster, points)
        tried = tried[hidden[tried] & is_large[tried]]
    return hidden


def hidden_share(mesh: Mesh) -> float:
    """The share of a surface's area, to half a percent, that no ray from outside reaches."""
    ends = np.cumsum(mesh.face_areas())
    number = np.arange(_SAMPLES) + 0.5
    faces = np.searchsorted(ends, ends[-1] * number / _SAMPLES)
    # Points that fill the faces evenly, by the additive sequence of the plastic number.
    first, second = np.sqrt(number * 0.7548776662 % 1), number * 0.5698402910 % 1
    weights = np.stack([1 - first, first * (1 - second), first * second], axis=1)
    points = np.einsum("fk,fkc->fc", weights, mesh.vertices[mesh.faces[faces]])
    return float(_are_hidden(Raycaster(mesh), points).mean())


def _are_hidden(caster: Raycaster, points: Floats) -> Mask:
    """(N,) whether points (N, 3) of the surface see the outside in no direction."""
    index = np.arange(_DIRECTIONS) + 0.5
    height, turn = 1.0 - 2.0 * index / _DIRECTIONS, index * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    directions = np.stack([across * np.cos(turn), height, across * np.sin(turn)], axis=1)
    lift = _LEAVE * float(caster.mesh.extent.max())
    left = np.arange(len(points))
    # Far apart one after the other, so that most points are done after a few.
    for direction in directions[index.astype(int) * 37 % _DIRECTIONS]:
        origins = points[left] + lift * direction
        left = left[~_free(caster, origins, np.broadcast_to(direction, origins.shape))]
        if len(left) == 0:
            break
    hidden = np.zeros(len(points), dtype=bool)
    hidden[left] = True
    return hidden


def _free(caster: Raycaster, origins: Floats, directions: Floats) -> NDArray[np.bool_]:
    blocked = caster.blocked(origins.reshape(-1, 3), directions.reshape(-1, 3))
    return ~blocked.reshape(directions.shape[:-1])


def _frames(normals: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (N, 3) each, at right angles to the normals and to each other."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    across = np.cross(normals, least)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across /= np.where(length > 0, length, 1.0)
    return across, np.cross(normals, across)


#: Added to linear light before its logarithm: the noise of dark pixels tells nothing.
DARK = 0.01

#: A surface that is seen at a more grazing angle is not coloured.
_LEAST_COSINE = 0.1
#: A vertex may lie this far behind the first hit of its ray.
_TOLERANCE_M = 3e-3
#: Two neighbouring pixels whose depths differ by more are of two surfaces: the larger of a
#: distance and of a slope in pixels' widths.
_JUMP_M, _JUMP_PIXELS = 0.01, 12.0
#: Pixels this near to a rim mix two surfaces, and are not used.
_MIXED_PX = 1.5
#: Of what lies behind a rim, so much beside it is not used, because the rim may be wrong by it.
_BEHIND_M = 0.01
#: Further from a rim than this, its distance no longer counts; so wrong may a surface be there.
_RIM_M, _RIM_PX = 0.012, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What one photo shows of a surface.

    Attributes:
        places: (N,) which points it shows, ascending.
        light: (N, 3) logarithm of linear light plus ``DARK``.
        worth: (N,) how well it shows them: pixels a square metre of surface, less near rims.
    """

    places: Ints
    light: Singles
    worth: Singles


def sight_of(photo: Photo, caster: Raycaster, points: Floats, normals: Floats) -> Sight:
    """What a photo shows of points on a surface; nothing where it shows none.

    Left out is what the frame cuts, what faces away or almost, what something hides, and what lies
    within ``_MIXED_PX`` of the photo's outline or of a rim of the surface.

    Args:
        photo: The view.
        caster: Rays against the surface.
        points: (N, 3) on it, world metres.
        normals: (N, 3) unit, out of it.
    """
    camera = photo.camera
    window = caster.window(camera)
    if window.is_empty:
        return Sight(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros(0, np.float32))
    toward = camera.eye_of(points) - points
    cosine = np.einsum("ij,ij->i", toward, normals) / np.linalg.norm(toward, axis=1)
    places = np.flatnonzero(cosine > _LEAST_COSINE)
    seen = caster.visible(points[places], camera, tolerance_m=_TOLERANCE_M)
    places = places[seen]
    view = photo.cropped(window)
    pixels, depth = view.camera.project(points[places])
    footprint_m = camera.spread(depth) / view.camera.K[0, 0]
    rim_px = sampled(_rim_distance_px(view, caster.depth(view.camera)), pixels)
    clear = rim_px > _MIXED_PX
    places, pixels = places[clear], pixels[clear]
    footprint_m, rim_px = footprint_m[clear], rim_px[clear]
    reach_px = np.maximum(_RIM_PX, _RIM_M / footprint_m)
    trust = np.clip((rim_px - _MIXED_PX) / reach_px, 0.02, 1.0) ** 2
    worth = trust * cosine[places] / footprint_m**2
    light = log_light(_linear_at(view, pixels))
    return Sight(places, light, worth.astype(np.float32))


def log_light(linear: Floats) -> Singles:
    """Logarithm of linear light plus ``DARK``, in which an exposure is a sum."""
    return np.log(np.maximum(linear, 0.0) + DARK).astype(np.float32)


def linear_light(log: Floats) -> Floats:
    """Linear light in [0, 1] behind ``log_light``."""
    return np.clip(np.exp(log) - DARK, 0.0, 1.0)


def _linear_at(photo: Photo, pixels: Floats) -> Floats:
    """(N, 3) linear light at pixels, bilinear among what the subject covers."""
    share = photo.coverage
    light = linear_texture(photo.rgba[..., :3]) * share[..., None]
    covered = np.maximum(sampled(share, pixels), 1e-3)
    return np.stack([sampled(light[..., c], pixels) / covered for c in range(3)], axis=1)


def _rim_distance_px(photo: Photo, depth: Floats) -> Floats:
    """(H, W) distance in pixels to where the photo's or the surface's outline or a rim is.

    Behind a rim it is counted from further away: where the surface is not exactly right, the photo
    shows there what is before it.
    """
    front, behind = _rims(depth, photo.camera)
    usable = photo.mask & np.isfinite(depth) & ~front & ~behind
    if not usable.any():
        return np.full(depth.shape, -0.5)
    return np.minimum(inner_depth_px(usable), _clear_of_front_px(front, depth, photo.camera))


def _clear_of_front_px(front: Mask, depth: Floats, camera: Camera) -> Floats:
    """(H, W) distance in pixels of what lies behind the nearest rim to where it is clear of it."""
    from scipy.ndimage import distance_transform_edt

    if not front.any():
        return np.full(depth.shape, np.inf)
    far: Floats
    far, (rows, columns) = distance_transform_edt(~front, return_indices=True)  # pyright: ignore
    nearest_m = depth[rows, columns]
    is_behind = depth - nearest_m > _JUMP_M
    clear_px = far - _BEHIND_M * camera.K[0, 0] / camera.spread(nearest_m)
    return np.where(is_behind, clear_px, np.inf)


def _rims(depth: Floats, camera: Camera) -> tuple[Mask, Mask]:
    """(H, W) where a surface ends before another, and (H, W) where that other begins."""
    front, behind = np.zeros(depth.shape, dtype=bool), np.zeros(depth.shape, dtype=bool)
    step_m = np.maximum(_JUMP_M, _JUMP_PIXELS * camera.spread(depth) / camera.K[0, 0])
    for here, there in (
        ((slice(1, None), slice(None)), (slice(None, -1), slice(None))),
        ((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
    ):
        deeper = depth[here] - depth[there]
        apart = np.abs(deeper) > np.minimum(step_m[here], step_m[there])
        front[there] |= apart & (deeper > 0)
        behind[here] |= apart & (deeper > 0)
        front[here] |= apart & (deeper < 0)
        behind[there] |= apart & (deeper < 0)
    return front, behind
