"""Where cameras stand by the landmarks of single photos: a first guess, to a few degrees.

The detector gives each photo the body's landmarks in space, in that camera's axes. Bringing them
together (generalised Procrustes, with left and right exchanged where that fits better) turns the
cameras; the landmarks in the picture place them; a bundle adjustment of both follows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from harness.core.arrays import Floats, Mask
from methods.body.photos.detection import COUNT, Detections
from methods.cameras.adjustment import Rig, Rows, pose_columns, seen, solved, sparse_rows

#: Landmarks of the face, the hands and the feet say less of where the body is.
_TRUST = np.ones(COUNT)
_TRUST[[*range(1, 7), 9, 10, *range(17, 23)]] = 0.3
_TRUST[29:] = 0.5
_HIPS = [23, 24]
_ROUNDS, _STARTS = 40, 3
#: Landmarks in space are off by about so much, metres. Left and right are exchanged where the mean
#: loss falls by more than the latter.
_SPACE_M, _SWAP = 0.1, 0.15
#: And in pictures.
_PICTURE_M = 0.015


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkRows:
    """Landmarks in pictures and in space against the rig's points, with logarithmic losses.

    Attributes:
        found: Of the rig's views.
        span_m: (C,) metres that a pixel spans of the person.
        sd_m: What landmarks in pictures are trusted to, metres.
        space_weight: How much landmarks in space, about the middle of the hips, count.
    """

    found: Detections
    span_m: Floats
    sd_m: float
    space_weight: float = 0.3

    def rows(self, rig: Rig) -> Rows:
        """(5 C N) residuals: across, down, and three in space."""
        count = len(rig)
        views, marks = (each.ravel() for each in np.indices((count, COUNT)))
        trust = (self.found.confidence * _TRUST)[views, marks]
        points = 6 * count + 1 + 3 * marks[:, None] + np.arange(3)
        shown = seen(rig, views, rig.points[marks])
        scale = self.span_m[views] / self.sd_m
        flat = (shown.pixels - self.found.pixels[views, marks]) * scale[:, None]
        focal = np.full((len(views), 1), 6 * count)
        parts = [
            sparse_rows(
                [
                    (pose_columns(views), shown.by_pose[:, axis] * scale[:, None]),
                    (points, shown.by_point[:, axis] * scale[:, None]),
                    (focal, shown.by_factor[:, [axis]] * scale[:, None]),
                ],
                rig.size,
            )
            for axis in range(2)
        ]
        hips = rig.points[_HIPS].mean(axis=0)
        turns = rig.rotations[views]
        bones = np.einsum("mij,mj->mi", turns, rig.points[marks] - hips)
        deep = (bones - self.found.points_camera[views, marks]) / _SPACE_M
        hip_columns = [
            np.full_like(points, 6 * count + 1 + 3 * hip) + np.arange(3) for hip in _HIPS
        ]
        for axis in range(3):
            by_point = turns[:, axis] / _SPACE_M
            # exp(w) b changes by w x b.
            unit = np.zeros(3)
            unit[axis] = 1.0
            by_turn = np.cross(bones, unit) / _SPACE_M
            entries = [(pose_columns(views)[:, :3], by_turn), (points, by_point)]
            entries += [(columns, -0.5 * by_point) for columns in hip_columns]
            parts.append(sparse_rows(entries, rig.size))
        return self._together(flat, deep, trust, parts)

    def _together(self, flat: Floats, deep: Floats, trust: Floats, parts: list[object]) -> Rows:
        from scipy.sparse import vstack

        squares = [(flat**2).sum(axis=1), (deep**2).sum(axis=1)]
        trusts = [trust, self.space_weight * trust]
        weights = [t / (1.0 + s) for t, s in zip(trusts, squares, strict=True)]
        cost = sum(float(t @ np.log1p(s)) for t, s in zip(trusts, squares, strict=True))
        return Rows(
            residuals=np.concatenate([*flat.T, *deep.T]),
            jacobian=vstack(parts).tocsr(),
            weights=np.concatenate([weights[0]] * 2 + [weights[1]] * 3),
            cost=cost,
        )


def landmark_spans(rig: Rig) -> Floats:
    """(C,) metres that a pixel spans of the person, where the rig's points are."""
    return rig.depths(rig.points.mean(axis=0)) / rig.focal.mean(axis=1)


def by_landmarks(rig: Rig, found: Detections) -> tuple[Rig, Detections]:
    """The rig that landmarks tell, and the landmarks with left and right as they fit.

    Args:
        rig: Focal lengths and principal points of its views; its poses are not read.
        found: Landmarks, in each view.
    """
    rotations, swapped, shape = _procrustes(found)
    told = found.mirrored(swapped)
    shifts = np.stack(
        [
            _placed(
                shape @ rotations[view].T,
                (told.pixels[view] - rig.middle[view]) / rig.focal[view],
                told.confidence[view] * _TRUST,
            )
            for view in range(len(rig))
        ]
    )
    rig = replace(rig, rotations=rotations, shifts=shifts, points=shape)
    return solved(rig, [LandmarkRows(told, landmark_spans(rig), _PICTURE_M)], _ROUNDS).rig, told


def _procrustes(found: Detections) -> tuple[Floats, Mask, Floats]:
    """(C, 3, 3) turns from the body to each camera, which are exchanged, and the (N, 3) body."""
    best: tuple[float, Floats, Mask, Floats] | None = None
    every = np.ones(len(found.confidence), dtype=bool)
    ways = [found, found.mirrored(every)]
    for first in np.argsort(-found.confidence.mean(axis=1), kind="stable")[:_STARTS]:
        shape = found.points_camera[first]
        chosen, swapped = [_fitted(shape, found, view) for view in range(len(every))], ~every
        for _ in range(_ROUNDS):
            fits = [[_fitted(shape, way, view) for view in range(len(every))] for way in ways]
            losses = np.array([[fit[0] for fit in row] for row in fits])
            swapped = losses[1] + _SWAP < losses[0]
            chosen = [fits[int(swap)][view] for view, swap in enumerate(swapped)]
            bodies, trusts = (np.stack([fit[k] for fit in chosen]) for k in (2, 3))
            shape = _robust_mean(shape, bodies, trusts)
        loss = float(sum(fit[0] for fit in chosen))
        if best is None or loss < best[0]:
            best = loss, np.stack([fit[1] for fit in chosen]), swapped, shape
    assert best is not None
    return best[1], best[2], best[3]


def _fitted(shape: Floats, found: Detections, view: int) -> tuple[float, Floats, Floats, Floats]:
    """Loss, turn from body to camera, the view's landmarks in the body's axes, and their trust."""
    trust = found.confidence[view] * _TRUST + 1e-6
    given, share = found.points_camera[view], trust / trust.sum()
    to, at = share @ given, share @ shape
    U, _, V = np.linalg.svd((given - to).T @ ((shape - at) * share[:, None]))
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))])
    turn = U @ handed @ V
    body = (given - to) @ turn + at
    off = ((body - shape) ** 2).sum(axis=1) / _SPACE_M**2
    return float(share @ np.log1p(off)), turn, body, trust


def _robust_mean(shape: Floats, bodies: Floats, trusts: Floats) -> Floats:
    for _ in range(3):
        off = ((bodies - shape) ** 2).sum(axis=2) / _SPACE_M**2
        weights = trusts / (1.0 + off)
        shape = (weights[..., None] * bodies).sum(axis=0) / weights.sum(axis=0)[:, None]
    return shape


def _placed(turned: Floats, rays: Floats, trust: Floats) -> Floats:
    """(3,) shift that brings points (N, 3) in camera axes before their rays (N, 2)."""
    rows = np.zeros((2, len(turned), 3))
    rows[0, :, 0] = rows[1, :, 1] = 1.0
    rows[:, :, 2] = -rays.T
    wanted = rays.T * turned[:, 2] - turned[:, :2].T
    weights = np.tile(np.sqrt(trust + 1e-6), 2)
    shift, base = np.zeros(3), weights
    for _ in range(5):
        weighted = rows.reshape(-1, 3) * weights[:, None]
        answer = np.linalg.lstsq(weighted, wanted.ravel() * weights, rcond=None)
        shift = answer[0].astype(np.float64)
        off = (rows @ shift - wanted).ravel() / max(float(shift[2]), 0.5)
        weights = base / np.sqrt(1.0 + (off / 0.01) ** 2)
    return shift
