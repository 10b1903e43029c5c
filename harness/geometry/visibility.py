"""What a photo shows of the vertices of a surface: which of them, in which light, how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Ints, Mask, Singles
from harness.core.camera import Camera
from harness.geometry.images import sampled
from harness.geometry.outline import inner_depth_px
from harness.geometry.photo import Photo, linear_texture
from harness.geometry.raycast import Raycaster

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
