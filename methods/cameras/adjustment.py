"""Cameras as unknowns, and the least squares that all stages share.

A camera moves by a turn w and a shift d in its own axes: R becomes exp(w) R and t becomes
exp(w) t + d. One factor multiplies all focal lengths. Blocks of rows give residuals and exact
derivatives; Levenberg and Marquardt's damped steps on dense normal equations find the least cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from harness.core.arrays import Floats, Ints
from harness.core.camera import Camera
from harness.core.camera_frames import require_perspective

_DAMPING, _HARDER, _EASIER = 1e-3, 8.0, 0.2
_TRIES = 6
#: A round that takes less than this share of the cost away is the last.
_REST = 1e-4
#: Nearer than this is behind the camera, metres.
_NEAREST_M = 1e-2


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Cameras and points that are adjusted.

    Attributes:
        rotations: (C, 3, 3) from world to camera axes.
        shifts: (C, 3) of world_to_camera, metres.
        base_focal: (C, 2) focal lengths before the common factor, pixels.
        middle: (C, 2) principal points, pixels.
        points: (N, 3) world metres; landmarks of the body.
        log_factor: Logarithm of the common factor of the focal lengths.
        factor_sd: What is known of that logarithm; 0 holds it.
    """

    rotations: Floats
    shifts: Floats
    base_focal: Floats
    middle: Floats
    points: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    log_factor: float = 0.0
    factor_sd: float = 0.0

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> Rig:
        """The rig of some cameras, with focal lengths that are held.

        Raises:
            DataError: one of them is orthographic.
        """
        require_perspective(cameras, "cannot be refined")
        K = np.stack([camera.K for camera in cameras])
        pose = np.stack([camera.world_to_camera for camera in cameras])
        focal = np.stack([K[:, 0, 0], K[:, 1, 1]], axis=1)
        return cls(pose[:, :3, :3], pose[:, :3, 3], focal, K[:, :2, 2])

    def __len__(self) -> int:
        return len(self.rotations)

    @property
    def focal(self) -> Floats:
        """(C, 2) focal lengths, pixels."""
        return self.base_focal * np.exp(self.log_factor)

    @property
    def eyes(self) -> Floats:
        """(C, 3) optical centres, world metres."""
        return -np.einsum("cji,cj->ci", self.rotations, self.shifts)

    @property
    def size(self) -> int:
        """Number of unknowns: six a camera, the factor, three a point."""
        return 6 * len(self) + 1 + 3 * len(self.points)

    def moved(self, step: Floats) -> Rig:
        """The rig after a step of all unknowns."""
        count = len(self)
        by = step[: 6 * count].reshape(count, 6)
        turns = Rotation.from_rotvec(by[:, :3]).as_matrix()
        return replace(
            self,
            rotations=turns @ self.rotations,
            shifts=np.einsum("cij,cj->ci", turns, self.shifts) + by[:, 3:],
            points=self.points + step[6 * count + 1 :].reshape(-1, 3),
            log_factor=self.log_factor + float(step[6 * count]),
        )

    def resized(self, scale: float) -> Rig:
        """The same in a world whose unit is another: all lengths times ``scale``."""
        return replace(self, shifts=self.shifts * scale, points=self.points * scale)

    def in_frame(self, rotation: Floats, origin: Floats) -> Rig:
        """The same in a world with other axes (3, 3) and another origin (3,)."""
        return replace(
            self,
            rotations=self.rotations @ rotation.T,
            shifts=self.shifts + self.rotations @ origin,
            points=(self.points - origin) @ rotation.T,
        )

    def at(self, views: Sequence[int] | Ints) -> Rig:
        """Some of its cameras, in that order."""
        chosen = np.asarray(views, dtype=np.int64)
        return replace(
            self,
            rotations=self.rotations[chosen],
            shifts=self.shifts[chosen],
            base_focal=self.base_focal[chosen],
            middle=self.middle[chosen],
        )

    def with_views(self, views: Sequence[int], other: Rig) -> Rig:
        """The rig with some cameras as another rig of only these has them, and its points."""
        rotations, shifts = self.rotations.copy(), self.shifts.copy()
        rotations[list(views)], shifts[list(views)] = other.rotations, other.shifts
        return replace(
            self,
            rotations=rotations,
            shifts=shifts,
            points=other.points,
            log_factor=other.log_factor,
        )

    def depths(self, point: Floats) -> Floats:
        """(C,) of a world point (3,) along each optical axis, metres."""
        return self.rotations[:, 2] @ point + self.shifts[:, 2]

    def cameras(self, sizes: Sequence[tuple[int, int]]) -> tuple[Camera, ...]:
        """They as cameras of pictures of these widths and heights."""
        found = []
        for view, (width, height) in enumerate(sizes):
            pose, K = np.eye(4), np.eye(3)
            U, _, V = np.linalg.svd(self.rotations[view])
            pose[:3, :3], pose[:3, 3] = U @ V, self.shifts[view]
            K[[0, 1], [0, 1]], K[:2, 2] = self.focal[view], self.middle[view]
            found.append(Camera(K, pose, width, height))
        return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Points as cameras see them, one camera a point.

    Attributes:
        pixels: (M, 2).
        by_pose: (M, 2, 6) pixels for a turn and a shift of the camera.
        by_point: (M, 2, 3) pixels for a world metre.
        by_factor: (M, 2) pixels for the logarithm of the focal lengths' factor.
    """

    pixels: Floats
    by_pose: Floats
    by_point: Floats
    by_factor: Floats


def seen(rig: Rig, views: Ints, points: Floats) -> Seen:
    """World points (M, 3), each in one view (M,), with derivatives."""
    turns, focal = rig.rotations[views], rig.focal[views]
    inside = np.einsum("mij,mj->mi", turns, points) + rig.shifts[views]
    depth = np.maximum(inside[:, 2], _NEAREST_M)
    beside = focal * inside[:, :2] / depth[:, None]
    by_camera = np.zeros((len(points), 2, 3))
    by_camera[:, [0, 1], [0, 1]] = focal / depth[:, None]
    by_camera[:, :, 2] = -beside / depth[:, None]
    by_pose = np.concatenate([-by_camera @ crosses(inside), by_camera], axis=2)
    return Seen(beside + rig.middle[views], by_pose, by_camera @ turns, beside)


def crosses(vectors: Floats) -> Floats:
    """(M, 3, 3) matrices that take the cross product of (M, 3) vectors with what follows."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Residuals at a rig, and how they change.

    Attributes:
        residuals: (M,).
        jacobian: (M, P) sparse, by the rig's unknowns.
        weights: (M,) of the squares, such as robust losses give them.
        cost: What is made small.
    """

    residuals: Floats
    jacobian: Any
    weights: Floats
    cost: float

    def normal(self) -> tuple[Floats, Floats]:
        """(P, P) and (P,) of the normal equations."""
        weighted = self.jacobian.multiply(self.weights[:, None]).tocsr().T
        matrix = (weighted @ self.jacobian).toarray()
        return matrix, weighted @ self.residuals


class Block(Protocol):
    """Something that a rig is to satisfy."""

    def rows(self, rig: Rig) -> Rows:
        """Its residuals there."""
        ...


def sparse_rows(entries: Sequence[tuple[Ints, Floats]], unknowns: int) -> Any:
    """(M, P) sparse from columns (M, K) and values (M, K); equal columns add up."""
    from scipy.sparse import coo_array

    columns = np.concatenate([column for column, _ in entries], axis=1)
    values = np.concatenate([value for _, value in entries], axis=1)
    rows = np.broadcast_to(np.arange(len(columns))[:, None], columns.shape)
    places = (rows.ravel(), columns.ravel())
    return coo_array((values.ravel(), places), shape=(len(columns), unknowns)).tocsr()


def pose_columns(views: Ints) -> Ints:
    """(M, 6) unknowns of the cameras of views (M,)."""
    return 6 * views[:, None] + np.arange(6)


def cauchy(residuals: Floats, sd: float, knee: float) -> tuple[Floats, float]:
    """(M,) weights of squares, and the cost, of a loss that grows slowly beyond ``knee`` sd."""
    share = (residuals / (sd * knee)) ** 2
    return 1.0 / (1.0 + share) / sd**2, float(knee**2 * np.log1p(share).sum())


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A least cost.

    Attributes:
        rig: Where it is.
        cost: There.
        before: Where the solution began.
        matrix: (P, P) of the normal equations there.
    """

    rig: Rig
    cost: float
    before: float
    matrix: Floats

    @property
    def gain(self) -> float:
        """Share of the cost that went away."""
        return 1.0 - self.cost / self.before if self.before > 0 else 0.0


def solved(
    rig: Rig, blocks: Sequence[Block], rounds: int, views: Sequence[int] | None = None
) -> Solved:
    """The rig of least cost near this one.

    Args:
        rig: To start from.
        blocks: What it is to satisfy.
        rounds: Most accepted steps.
        views: The cameras that may move, and nothing else; None moves all there is.
    """
    matrix, slope, cost = _equations(rig, blocks)
    before, damping = cost, _DAMPING
    free = _free(rig, matrix, views)
    for _ in range(rounds):
        inner = matrix[np.ix_(free, free)]
        for _ in range(_TRIES):
            step = np.zeros(rig.size)
            damped = inner + np.diag(damping * inner.diagonal() + 1e-12)
            step[free] = -np.linalg.solve(damped, slope[free])
            tried = rig.moved(step)
            found = _equations(tried, blocks)
            if found[2] < cost:
                break
            damping *= _HARDER
        else:
            break
        gone = cost - found[2]
        rig, (matrix, slope, cost) = tried, found
        damping = max(damping * _EASIER, 1e-9)
        if gone < _REST * cost:
            break
    return Solved(rig, cost, before, matrix)


def _equations(rig: Rig, blocks: Sequence[Block]) -> tuple[Floats, Floats, float]:
    matrix, slope, cost = np.zeros((rig.size, rig.size)), np.zeros(rig.size), 0.0
    if rig.factor_sd > 0:
        place, weight = 6 * len(rig), rig.factor_sd**-2
        matrix[place, place] = weight
        slope[place] = weight * rig.log_factor
        cost += weight * rig.log_factor**2
    for block in blocks:
        rows = block.rows(rig)
        more, steeper = rows.normal()
        matrix += more
        slope += steeper
        cost += rows.cost
    return matrix, slope, cost


def _free(rig: Rig, matrix: Floats, views: Sequence[int] | None) -> Ints:
    """The unknowns that are solved for."""
    if views is not None:
        return pose_columns(np.asarray(views, dtype=np.int64)).ravel()
    told = matrix.diagonal() > 0
    told[6 * len(rig)] = rig.factor_sd > 0
    return np.flatnonzero(told)
