"""Gaussians to depth maps: where the front layer of a splatted scene is, seen by a camera.

A Gaussian is met where a ray passes it at its densest, which is the plane of a flat one. Which
layer is in front follows from opacity, front to back; where that layer is, is told by the plane
through all Gaussians that belong to it, whatever their order: front to back, the nearer half of a
sloping layer would count more, and the surface would lie before itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.camera import Camera, look_at
from harness.core.results import Gaussians
from methods.points.filtering import grid_normals

#: Longest side of a picture, pixels; and how many fragments are worked on at a time.
LONGEST_PX, _AT_ONCE = 640, 1_000_000
#: A Gaussian reaches as far as it is not fainter than this.
_FAINTEST = 0.02
#: A flat one is so thin, as a share of its width; and none is narrower than this, pixels.
_THINNEST, _NARROWEST_PX = 1e-3, 0.3
#: What belongs to the front layer, standard deviations from its depth; and how little a slope may
#: follow from, as a share of what the layer spreads over the picture.
_LAYER, _RIDGE = 3.0, 1e-3
#: Pixels whose surface is seen at less than this cosine say too little of where it is.
_LEAST_FACING = 0.35
_AROUND, _FOCAL = 26, 2.5


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Gaussians before a camera, in pixels and in units in which each is a unit ball.

    Attributes:
        to_ball: (N, 3, 3) from world directions.
        centre: (N, 3).
        width: (N,) largest standard deviation, world units.
        opacity: (N,).
        pixel: (N, 2) of the centre.
        box: (N, 4) first and last column, first and last row.
    """

    to_ball: Floats
    centre: Floats
    width: Floats
    opacity: Floats
    pixel: Floats
    box: Ints


def rendered_depth(gaussians: Gaussians, camera: Camera) -> tuple[Floats, Floats]:
    """(H, W) depth of the front layer along the optical axis, and (H, W) opacity, 0 to 1.

    Depth is NaN where half of the light passes, and where the layer is seen too obliquely.
    """
    seen = _seen(gaussians, camera)
    depth = np.full(camera.height * camera.width, np.nan)
    opacity = np.zeros(camera.height * camera.width)
    pixels = camera.pixel_centres().reshape(-1, 2)
    rays, eyes = camera.ray_directions(pixels), camera.ray_origins(pixels)
    for owner, pixel in _fragments(seen, camera):
        to_ball = seen.to_ball[owner]
        ray = np.einsum("nij,nj->ni", to_ball, rays[pixel])
        eye = np.einsum("nij,nj->ni", to_ball, eyes[pixel] - seen.centre[owner])
        there = -np.einsum("ni,ni->n", eye, ray) / np.einsum("ni,ni->n", ray, ray)
        off = eye + there[:, None] * ray
        alpha = seen.opacity[owner] * np.exp(-0.5 * np.einsum("ni,ni->n", off, off))
        kept = (alpha > _FAINTEST) & (there > 0)
        owner, pixel, there, alpha = owner[kept], pixel[kept], there[kept], alpha[kept]
        if len(pixel):
            middle = np.stack([pixel % camera.width, pixel // camera.width], axis=1) + 0.5
            met = _Met(pixel, there, alpha, seen.width[owner], seen.pixel[owner] - middle)
            _blend(met, (depth, opacity))
    shape = camera.height, camera.width
    depth, opacity = depth.reshape(shape), opacity.reshape(shape)
    facing = grid_normals(depth, np.isfinite(depth), camera, 2)
    towards = -np.einsum("hwi,hwi->hw", facing, rays.reshape(*shape, 3))
    towards /= np.linalg.norm(rays, axis=1).reshape(shape)
    return np.where(towards >= _LEAST_FACING, depth, np.nan), opacity


def cameras_around(points: Floats) -> tuple[Camera, ...]:
    """Cameras on all sides of points (N, 3), each of which sees them all."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-9)
    side = LONGEST_PX
    K = np.array([[_FOCAL * side, 0, side / 2], [0, _FOCAL * side, side / 2], [0, 0, 1.0]])
    away = (2 * _FOCAL + 1) * radius
    return tuple(
        Camera(K, look_at(centre + away * way, centre, _up(way)), side, side)
        for way in directions(_AROUND)
    )


def directions(count: int) -> Floats:
    """(count, 3) unit vectors, evenly on the sphere (a Fibonacci lattice)."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    flat = np.sqrt(1 - height**2)
    return np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=1)


def _up(way: Floats) -> tuple[float, float, float]:
    return (0.0, 1.0, 0.0) if abs(way[1]) < 0.9 else (0.0, 0.0, 1.0)


def _seen(gaussians: Gaussians, camera: Camera) -> _Seen:
    pixels, depth = camera.project(gaussians.centres)
    focal = camera.K[0, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        pixel = camera.spread(depth) / focal
        scales = np.maximum(gaussians.scales, _THINNEST * gaussians.scales.max(axis=1)[:, None])
        # What is narrower than a pixel would fall between two; its thickness may be anything.
        thin = np.argmin(scales, axis=1)[:, None] == np.arange(3)
        scales = np.where(thin, scales, np.maximum(scales, _NARROWEST_PX * pixel[:, None]))
        width = scales.max(axis=1)
        faint = np.maximum(gaussians.opacities / _FAINTEST, 1.0)
        reach = width * np.sqrt(2 * np.log(faint))
        # What comes nearer looks larger, but to parallel rays.
        nearer = 1.0 if camera.is_orthographic else np.maximum(1 - reach / depth, 0.1)
        reach = reach / (pixel * nearer) + 1
        box = np.stack(
            [
                np.clip(np.floor(pixels[:, 0] - reach), 0, camera.width),
                np.clip(np.ceil(pixels[:, 0] + reach), 0, camera.width),
                np.clip(np.floor(pixels[:, 1] - reach), 0, camera.height),
                np.clip(np.ceil(pixels[:, 1] + reach), 0, camera.height),
            ],
            axis=1,
        )
        used = (depth > 0) & (box[:, 1] > box[:, 0]) & (box[:, 3] > box[:, 2])
        used &= (gaussians.opacities > _FAINTEST) & (width > 0)
    to_ball = (
        np.swapaxes(gaussians.axes()[used], 1, 2) / np.maximum(scales[used], 1e-12)[:, :, None]
    )
    opacity = np.minimum(gaussians.opacities[used], 0.99)
    centre = gaussians.centres[used]
    return _Seen(to_ball, centre, width[used], opacity, pixels[used], box[used].astype(np.int64))


def _fragments(seen: _Seen, camera: Camera) -> Iterator[tuple[Ints, Ints]]:
    """Which Gaussian may touch which pixel, for bands of rows: (M,) Gaussians and (M,) pixels."""
    left, right, top, bottom = seen.box.T
    steps = np.zeros(camera.height + 1, dtype=np.int64)
    np.add.at(steps, top, right - left)
    np.add.at(steps, bottom, left - right)
    rows, first = np.cumsum(steps[:-1]), 0
    while first < camera.height:
        # As many rows as may be worked on at once, and at least one.
        count = int(np.searchsorted(np.cumsum(rows[first:]), _AT_ONCE, side="right"))
        last = min(first + max(count, 1), camera.height)
        low, high = np.maximum(top, first), np.minimum(bottom, last)
        touching = np.flatnonzero(high > low)
        wide = (right - left)[touching]
        number = wide * (high - low)[touching]
        owner = np.repeat(touching, number)
        place = np.arange(len(owner)) - np.repeat(np.cumsum(number) - number, number)
        across = np.repeat(wide, number)
        yield owner, (low[owner] + place // across) * camera.width + left[owner] + place % across
        first = last


@dataclass(frozen=True, slots=True, eq=False)
class _Met:
    """Gaussians that rays meet, one row for each pixel of each.

    Attributes:
        pixel: (M,) which.
        there: (M,) at what depth.
        alpha: (M,) how much light stays there.
        width: (M,) the Gaussian's largest standard deviation.
        aside: (M, 2) from the pixel to the Gaussian's centre, pixels.
    """

    pixel: Ints
    there: Floats
    alpha: Floats
    width: Floats
    aside: Floats


def _blend(met: _Met, into: tuple[Floats, Floats]) -> None:
    """Write depth and opacity of all pixels that are met."""
    order = np.lexsort((met.there, met.pixel))
    pixel, there, alpha = met.pixel[order], met.there[order], met.alpha[order]
    starts = np.flatnonzero(np.r_[True, pixel[1:] != pixel[:-1]])
    owner = np.repeat(np.arange(len(starts)), np.diff(np.r_[starts, len(pixel)]))
    passed = np.cumsum(np.log1p(-alpha))
    passed -= np.r_[0.0, passed][starts][owner]
    # The first one after which less than half of the light is left.
    half = np.flatnonzero(passed <= np.log(0.5))
    pixels, first = np.unique(owner[half], return_index=True)
    front = np.full(len(starts), np.nan)
    front[pixels] = there[half[first]]
    with np.errstate(invalid="ignore"):
        layer = np.abs(there - front[owner]) <= _LAYER * met.width[order]
    behind = (there - front[owner])[layer]
    depth, opacity = into
    depth[pixel[starts]] = front + _at_pixel(
        owner[layer], len(starts), alpha[layer] ** 2, behind, met.aside[order][layer]
    )
    opacity[pixel[starts]] = -np.expm1(passed[np.r_[starts[1:], len(pixel)] - 1])


def _at_pixel(owner: Ints, count: int, weight: Floats, value: Floats, aside: Floats) -> Floats:
    """(count,) values at the pixels, of the planes that fit those beside them with least squares.

    A slope makes whatever part of a layer was met count as the whole of it.
    """
    u, v = aside.T

    def total(values: Floats) -> Floats:
        return np.bincount(owner, weight * values, count).astype(np.float64, copy=False)

    all_of = np.maximum(total(np.ones_like(u)), 1e-12)
    mu, mv, mz = (total(each) / all_of for each in (u, v, value))
    du, dv, dz = u - mu[owner], v - mv[owner], value - mz[owner]
    uu, vv, uv = total(du * du), total(dv * dv), total(du * dv)
    ridge = _RIDGE * (uu + vv) + 1e-9
    uu, vv = uu + ridge, vv + ridge
    uz, vz = total(du * dz), total(dv * dz)
    scale = uu * vv - uv * uv
    return mz - (mu * (vv * uz - uv * vz) + mv * (uu * vz - uv * uz)) / scale
