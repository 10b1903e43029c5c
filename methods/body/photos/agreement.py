"""Landmarks that views agree on: each view's own where it fits the others', else where they put it.

What one picture says of depth is off by 8 to 13 cm at elbows, wrists, knees and ankles, and a
hidden limb is guessed in the picture, too: the fit to one view has one minimum, which follows
these. Where three views or more agree on a landmark, their pictures tell where it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from harness.core.arrays import Floats, Mask
from harness.core.camera import Camera
from methods.body.photos.detection import Detections
from methods.body.photos.views import Views

#: A ray that passes a landmark further away than this contradicts it.
_NEAR_M = 0.05
#: So many views that do not contradict each other are agreement.
_LEAST_VIEWS = 3
#: Rays that leave the distance along one direction open by more: the least eigenvalue of what they
#: say of places is half their number for views all around, and a tenth for two 37 degrees apart.
_LEAST_SHARE = 0.1
_ROUNDS = 30
_HIPS = [23, 24]


def placed(
    cameras: Sequence[Camera], pixels: Floats, confidence: Floats, near_m: float = _NEAR_M
) -> tuple[Floats, Floats, Mask]:
    """World points that pixels of N cameras agree on; a few wrong ones do little.

    Every two rays propose a point, and the one that costs least by all is settled.

    Args:
        cameras: N.
        pixels: (N, K, 2) where they show K points.
        confidence: (N, K).
        near_m: A ray that passes a point at this distance counts half.

    Returns:
        (K, 3) points, metres; (N, K) distances of rays from them, metres; (K,) whether at least
        three cameras agree on the point.
    """
    origins = np.array([c.ray_origins(seen) for c, seen in zip(cameras, pixels, strict=True)])
    ways = np.array([c.ray_directions(seen) for c, seen in zip(cameras, pixels, strict=True)])
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    across = np.eye(3) - ways[..., :, None] * ways[..., None, :]
    on_rays = np.einsum("nkij,nkj->nki", across, origins)

    def nearest(weights: Floats) -> tuple[Floats, Floats]:
        """(K, 3) points, and (K, 3, 3) what weighted rays say of places."""
        told = np.einsum("nk,nkij->kij", weights, across)
        right = np.einsum("nk,nki->ki", weights, on_rays)
        return np.linalg.solve(told + 1e-9 * np.eye(3), right[..., None])[..., 0], told

    def missed(points: Floats) -> Floats:
        return np.linalg.norm(np.einsum("nkij,kj->nki", across, points) - on_rays, axis=2)

    def trusted(points: Floats) -> Floats:
        return confidence / (1.0 + (missed(points) / near_m) ** 2)

    best, points = np.full(pixels.shape[1], np.inf), np.zeros((pixels.shape[1], 3))
    for pair in combinations(range(len(cameras)), 2):
        two = np.zeros(confidence.shape)
        two[list(pair)] = 0.5
        proposed, told = nearest(two)
        cost = (confidence * np.log1p((missed(proposed) / near_m) ** 2)).sum(axis=0)
        cost = np.where(np.linalg.eigvalsh(told)[:, 0] < _LEAST_SHARE, np.inf, cost)
        points = np.where((cost < best)[:, None], proposed, points)
        best = np.minimum(best, cost)
    for _ in range(_ROUNDS):
        points = nearest(trusted(points) + 1e-12)[0]
    misses, weights = missed(points), trusted(points) + 1e-12
    near = misses < near_m
    share = np.linalg.eigvalsh(nearest(weights)[1])[:, 0] / weights.sum(axis=0)
    is_agreed = (near.sum(axis=0) >= _LEAST_VIEWS) & (share > _LEAST_SHARE) & np.isfinite(best)
    return points, misses, is_agreed


def agreed(views: Views) -> Detections:
    """What was found in the views, made to agree.

    A landmark that three views or more agree on is where they put it in space, as sure as their
    mean, and in the picture of a view that contradicts them. All others stay as they were found.
    """
    own = views.detections
    cameras = [view.camera for view in views.views]
    if len(cameras) < _LEAST_VIEWS:
        return own
    points, misses, is_agreed = placed(cameras, own.pixels, own.confidence)
    if not is_agreed[_HIPS].all():
        return own
    near = misses < _NEAR_M
    sure = (own.confidence * near).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
    about_hips = points - points[_HIPS].mean(axis=0)
    shown = np.array([camera.project(points)[0] for camera in cameras])
    in_space = np.array([about_hips @ camera.rotation.T for camera in cameras])
    return replace(
        own,
        pixels=np.where((is_agreed & ~near)[..., None], shown, own.pixels),
        points_camera=np.where(is_agreed[None, :, None], in_space, own.points_camera),
        confidence=np.where(is_agreed, np.maximum(own.confidence, sure), own.confidence),
    )
