"""By how much photos lie beside where their cameras have them: one small least-squares problem.

Let a camera be off so that its photo shows everything ``d`` pixels beside where the camera projects
it. Two photos i and j then match where a point is moved by a wrong offset along its normal, and by
how much it is wrong is linear in ``d_i`` and ``d_j``. Two pairs that see one point share its true
offset, so that the difference of what they say depends on the cameras alone. A shift across the
lines along which a pair is matched leaves offsets as they are, but the photos match better when one
of them is moved across; that is a second kind of row.

Moving the subject and all cameras together changes no row. Of all answers the least one is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.cameras.camera import Camera

#: Differences of offsets are trusted up to about this, metres, and shifts across up to so many
#: pixels; larger ones are outliers and count less and less.
_TRUSTED_M, _TRUSTED_PX = 0.0015, 0.5
#: Photos are expected to lie this many pixels off. Neighbouring points tell nearly the same: so
#: many count as one.
_EXPECTED_PX, _ALIKE = 2.0, 50.0
#: More points of a pair than this say nothing new about its shift across.
_MOST_POINTS = 500
_ROUNDS = 12
#: A direction with a smaller horizontal part has no tangent across the vertical.
_LEAST_ACROSS = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Contradictions:
    """Points that two pairs of views tell the offset of.

    Attributes:
        points: (N, 3) world metres.
        normals: (N, 3) unit directions along which they were searched.
        pair: (N, 2) numbers of the two pairs.
        offsets: (N, 2) what each says, metres.
        weights: (N,) how much each point counts.
    """

    points: Floats
    normals: Floats
    pair: Ints
    offsets: Floats
    weights: Floats

    @property
    def differences_m(self) -> Floats:
        """(N,) what the first pair says minus what the second does."""
        return self.offsets[:, 0] - self.offsets[:, 1]


@dataclass(frozen=True, slots=True, eq=False)
class Across:
    """By how much the second photo of a pair lies across the lines of matching.

    Attributes:
        number: Of the pair.
        points: (K, 3) on the surface, world metres.
        normals: (K, 3) unit directions out of it.
        pixels: (K,) along ``across_direction``, pixels.
    """

    number: int
    points: Floats
    normals: Floats
    pixels: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Shifts:
    """The answer.

    Attributes:
        pixels: (C, 2) by how much each photo lies right of and below where its camera has it.
        points: How many points told them.
        before_m, after_m: Median contradiction of two pairs without and with these shifts, metres.
    """

    pixels: Floats
    points: int
    before_m: float
    after_m: float


def solved_shifts(
    cameras: Sequence[Camera],
    pairs: Sequence[tuple[int, int]],
    told: Contradictions,
    across: Sequence[Across],
) -> Shifts:
    """The least shifts that explain what pairs of photos say.

    Args:
        cameras: Of the photos that were matched.
        pairs: The views that are matched with each other.
        told: Points that two pairs see; at least one.
        across: What moving one photo of a pair across says, at most once for each pair.
    """
    count = 2 * len(cameras)
    rows = _offset_rows(cameras, pairs, told)
    wanted = told.differences_m
    sides = [_across_row(cameras, pairs[each.number], each) for each in across]
    row_px = np.array([np.median(each.pixels) for each in across])
    # A row of a pair counts like its points, in units of what is trusted.
    weight_px = np.array([min(len(each.pixels), _MOST_POINTS) for each in across])
    hold = np.eye(count) * _ALIKE / _EXPECTED_PX**2
    shifts = np.zeros(count)
    for _ in range(_ROUNDS):
        off = (wanted - rows @ shifts) / _TRUSTED_M
        weights = told.weights / (1.0 + off**2) / _TRUSTED_M**2
        weighted = rows * weights[:, None]
        matrix, right = weighted.T @ rows + hold, weighted.T @ wanted
        if sides:
            side = np.stack(sides)
            beside = (row_px - side @ shifts) / _TRUSTED_PX
            counted = side * (weight_px / (1.0 + beside**2) / _TRUSTED_PX**2)[:, None]
            matrix, right = matrix + counted.T @ side, right + counted.T @ row_px
        shifts = np.linalg.solve(matrix, right)
    return Shifts(
        shifts.reshape(-1, 2),
        len(told.points),
        float(np.median(np.abs(wanted))),
        float(np.median(np.abs(wanted - rows @ shifts))),
    )


def across_direction(first: Camera, second: Camera, point: Floats) -> Floats:
    """(2,) unit direction in the second photo across the line of the first's ray to a point (3,).

    Down rather than up.
    """
    ray = point - first.position
    along = _jacobians(second, point[None])[0] @ ray
    across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-12)
    return across if across[1] >= 0 else -across


def _offset_rows(
    cameras: Sequence[Camera], pairs: Sequence[tuple[int, int]], told: Contradictions
) -> Floats:
    """(N, 2 C) change of the two pairs' difference, metres, per pixel of each shift."""
    tangents = _tangents(told.normals)
    rows = np.zeros((len(told.points), 2 * len(cameras)))
    for number, (first, second) in enumerate(pairs):
        for place, sign in ((0, 1.0), (1, -1.0)):
            at = np.flatnonzero(told.pair[:, place] == number)
            if not len(at):
                continue
            ours, theirs = (
                _on_surface(cameras[view], told.points[at], tangents[at])
                for view in (first, second)
            )
            normal = told.normals[at]
            parallax = ours.moved_by(normal) - theirs.moved_by(normal)
            share = parallax / np.maximum((parallax**2).sum(axis=1, keepdims=True), 1e-12)
            for view, to_tangent, turn in (
                (first, ours.to_tangent, sign),
                (second, theirs.to_tangent, -sign),
            ):
                rows[at, 2 * view : 2 * view + 2] += turn * np.einsum(
                    "ni,nij->nj", share, to_tangent
                )
    return rows


def _across_row(cameras: Sequence[Camera], pair: tuple[int, int], told: Across) -> Floats:
    """(2 C,) change of a pair's shift across per pixel of each shift."""
    first, second = pair
    direction = across_direction(cameras[first], cameras[second], told.points.mean(axis=0))
    tangents = _tangents(told.normals)
    ours = _on_surface(cameras[first], told.points, tangents)
    # What a shift in the first photo looks like in the second.
    carried = (_jacobians(cameras[second], told.points) @ tangents) @ ours.to_tangent
    row = np.zeros(2 * len(cameras))
    row[2 * second : 2 * second + 2] = direction
    row[2 * first : 2 * first + 2] = -direction @ np.median(carried, axis=0)
    return row


@dataclass(frozen=True, slots=True, eq=False)
class _OnSurface:
    """How a camera sees the tangent planes of some points.

    Attributes:
        to_tangent: (N, 2, 2) metres on the plane per pixel.
        jacobians: (N, 2, 3) pixels per world metre.
    """

    to_tangent: Floats
    jacobians: Floats

    def moved_by(self, directions: Floats) -> Floats:
        """(N, 2) metres on the plane by which the picture moves per metre along directions."""
        pixels = np.einsum("nij,nj->ni", self.jacobians, directions)
        return np.einsum("nij,nj->ni", self.to_tangent, pixels)


def _on_surface(camera: Camera, points: Floats, tangents: Floats) -> _OnSurface:
    jacobians = _jacobians(camera, points)
    return _OnSurface(np.linalg.inv(jacobians @ tangents), jacobians)


def _tangents(normals: Floats) -> Floats:
    """(N, 3, 2) two unit directions across each normal and across each other."""
    first = np.cross(normals, [0.0, 1.0, 0.0])
    steep = np.linalg.norm(first, axis=1) < _LEAST_ACROSS
    first[steep] = np.cross(normals[steep], [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=2)


def _jacobians(camera: Camera, points: Floats) -> Floats:
    """(N, 2, 3) change of the projections of world points (N, 3), pixels per metre."""
    x, y, depth = (points @ camera.rotation.T + camera.world_to_camera[:3, 3]).T
    in_camera = np.zeros((len(points), 2, 3))
    in_camera[:, 0, 0], in_camera[:, 0, 2] = 1.0 / depth, -x / depth**2
    in_camera[:, 1, 1], in_camera[:, 1, 2] = 1.0 / depth, -y / depth**2
    focal = np.array([camera.K[0, 0], camera.K[1, 1]])
    return focal[:, None] * in_camera @ camera.rotation
