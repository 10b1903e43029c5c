"""Similarities, and the one that takes estimated cameras to known ones, never by a surface.

It is found from the cameras' centres and the directions of all three of their axes (Umeyama,
"Least-squares estimation of transformation parameters between two point patterns", PAMI 1991). The
axes matter where the centres lie on a line, as those of two views always do: about that line the
centres alone say nothing. Where cameras of the same pixels are compared, what they show counts:
errors of a centre and of a rotation that no pixel tells apart then move nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.core.errors import MethodError

#: Centres closer together than this share of their distance from the world's origin are one place.
_ONE_PLACE = 1e-9
#: A mirrored world is told when it fits so much better than any turned one, and the turned one is
#: off by so much of the centres' spread.
_MIRROR_SHARE, _MIRROR_LEAST = 0.5, 0.05
#: Beyond this the cameras were not found, and no surface follows from them: degrees, and shares of
#: the centres' spread. Good estimates are off by 2 degrees, bad ones by 5 to 20.
_WORST_DEG, _WORST_SHARE = 30.0, 0.5
_NOT_UNDERSTOOD = "Look at the photos: the source did not find how they belong together"


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """A turn, a scale and a shift: ``scale * rotation @ x + shift``.

    Attributes:
        scale: Metres per unit.
        rotation: (3, 3), right-handed.
        shift: (3,) metres.
    """

    scale: float
    rotation: Floats
    shift: Floats

    @classmethod
    def of(cls, matrix: Floats) -> Similarity:
        """The similarity that a (4, 4) matrix is."""
        scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
        return cls(scale, matrix[:3, :3] / scale, matrix[:3, 3])

    @property
    def matrix(self) -> Floats:
        """(4, 4) the same as a matrix."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.scale * self.rotation, self.shift
        return matrix

    def points(self, points: Floats) -> Floats:
        """(N, 3) moved points."""
        return self.scale * points @ self.rotation.T + self.shift

    def camera(self, camera: Camera) -> Camera:
        """The camera in the new world; depths in it are ``scale`` times what they were."""
        turned = camera.rotation @ self.rotation.T
        move = np.eye(4)
        move[:3, :3] = turned
        move[:3, 3] = -turned @ self.points(camera.position[None])[0]
        return camera.posed(move, self.scale)

    def then(self, other: Similarity) -> Similarity:
        """This one first, the other afterwards."""
        return Similarity(
            self.scale * other.scale,
            other.rotation @ self.rotation,
            other.points(self.shift[None])[0],
        )


@dataclass(frozen=True, slots=True, eq=False)
class CameraFit:
    """A similarity between cameras, and what it leaves.

    Attributes:
        similarity: From the found cameras' world to the known ones'.
        centre_rms_m: Root mean square distance of the moved centres from the known ones.
        angle_rms_deg: The same of the angles between the cameras' rotations.
    """

    similarity: Similarity
    centre_rms_m: float
    angle_rms_deg: float

    def details(self) -> dict[str, object]:
        """What a record says of it."""
        return {
            "scale": float(self.similarity.scale),
            "centre_rms_mm": round(1e3 * self.centre_rms_m, 3),
            "angle_rms_deg": round(self.angle_rms_deg, 3),
        }


def camera_similarity(found: Sequence[Camera], known: Sequence[Camera]) -> CameraFit:
    """The similarity that takes found cameras onto known ones, two views or more.

    Raises:
        MethodError: fewer than two views, cameras at one place, or a mirrored world.
    """
    if len(found) != len(known) or len(found) < 2:
        raise MethodError(
            "cameras cannot be aligned",
            expected="two views or more, with as many known cameras",
            got=f"{len(found)} and {len(known)}",
        )
    first, first_spread = _pattern(found, "estimated")
    second, second_spread = _pattern(known, "known")
    rotation = _turn(first, second)
    _refuse_mirrored(first, second)
    start, end = (np.stack([each.position for each in some]) for some in (found, known))
    centred, goal = start - start.mean(axis=0), end - end.mean(axis=0)
    scale = float(((centred @ rotation.T) * goal).sum() / (centred**2).sum())
    if scale <= 1e-6 * second_spread / first_spread:
        raise MethodError(
            "the estimated cameras do not stand as the known ones do",
            expected="centres in the same arrangement",
            got=f"a scale of {scale:.3g}",
            hint=_NOT_UNDERSTOOD,
        )
    shift = end.mean(axis=0) - scale * rotation @ start.mean(axis=0)
    moved = Similarity(scale, rotation, shift)
    apart = np.linalg.norm(moved.points(start) - end, axis=1)
    fit = CameraFit(moved, _rms(apart), _rms(_angles_deg(found, known, rotation)))
    if fit.angle_rms_deg > _WORST_DEG or fit.centre_rms_m > _WORST_SHARE * second_spread:
        raise MethodError(
            "the estimated cameras do not stand as the known ones do",
            expected=f"rotations within {_WORST_DEG:g} deg, centres within half of their spread",
            got=f"{fit.angle_rms_deg:.1f} deg and {fit.centre_rms_m / second_spread:.2f} of it",
            hint=_NOT_UNDERSTOOD,
        )
    return fit


def similarity_of_pictures(found: Sequence[Camera], known: Sequence[Camera]) -> Similarity:
    """The similarity after which found cameras show what known ones look at in the same pixels.

    Least squares in pixels over a cube about the point that the known cameras look at, from
    ``camera_similarity`` on. A focal length that is off, with a distance that makes up for it,
    leaves the size of what stands there right; the centres alone would scale it.

    Args:
        found: Estimated cameras, of the known ones' photos and sizes.
        known: The known ones.

    Raises:
        MethodError: as ``camera_similarity``, or a found camera does not see the cube.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    start = camera_similarity(found, known).similarity
    middle, reach = _looked_at(known)
    around = reach * np.stack(np.meshgrid(*3 * [(-1.0, 0.0, 1.0)]), axis=-1).reshape(-1, 3)
    goal = np.concatenate([camera.project(middle + around)[0] for camera in known])
    back = Similarity.of(np.linalg.inv(start.matrix))

    def placed(x: Floats) -> Similarity:
        """From the known cameras' world to the found ones'; ``x`` turns, shifts and scales it."""
        rotation, scale = Rotation.from_rotvec(x[:3]).as_matrix(), float(np.exp(x[6]))
        return Similarity(
            scale, rotation, middle + reach * x[3:6] - scale * rotation @ middle
        ).then(back)

    def off_px(x: Floats) -> Floats:
        points = placed(x).points(middle + around)
        seen = np.concatenate([camera.project(points)[0] for camera in found])
        return (seen - goal)[np.isfinite(goal)]

    if not np.isfinite(off_px(np.zeros(7))).all():
        raise MethodError(
            "the estimated cameras do not see what the known ones look at", hint=_NOT_UNDERSTOOD
        )
    best = least_squares(off_px, np.zeros(7), method="lm").x
    return Similarity.of(np.linalg.inv(placed(best).matrix))


def _looked_at(cameras: Sequence[Camera]) -> tuple[Floats, float]:
    """(3,) the point nearest to all optical axes, and half the side of a cube that they see."""
    centres = np.stack([camera.position for camera in cameras])
    ahead = np.stack([camera.forward for camera in cameras])
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None]
    about = centres.mean(axis=0)
    # Opposite cameras have one axis: then the place in the middle.
    to_axes = np.einsum("nij,nj->i", across, centres - about)
    middle = about + np.linalg.lstsq(across.sum(axis=0), to_axes, rcond=1e-6)[0]
    reach = [
        0.5 * min(camera.width, camera.height) * depth / camera.K[0, 0]
        for camera in cameras
        for depth in camera.spread(camera.project(middle[None])[1])
    ]
    return middle, float(min(reach)) / 2


def point_similarity(start: Floats, end: Floats) -> Similarity:
    """The similarity that takes points (N, 3) onto others (N, 3) with least squares, no mirroring.

    Raises:
        MethodError: all points are at one place.
    """
    centred, goal = start - start.mean(axis=0), end - end.mean(axis=0)
    size = float((centred**2).sum())
    if size <= 0:
        raise MethodError("points cannot be aligned", got="all of them at one place")
    rotation = _turn(centred, goal)
    scale = float(((centred @ rotation.T) * goal).sum() / size)
    return Similarity(scale, rotation, end.mean(axis=0) - scale * rotation @ start.mean(axis=0))


def _pattern(cameras: Sequence[Camera], which: str) -> tuple[Floats, float]:
    """(4 N, 3) centres about their mean, of spread 1, and the axes' directions; and the spread."""
    centres = np.stack([camera.position for camera in cameras])
    centred = centres - centres.mean(axis=0)
    spread = float(np.sqrt((centred**2).sum(axis=1).mean()))
    if spread <= _ONE_PLACE * max(1.0, float(np.abs(centres).max())):
        raise MethodError(
            f"the {which} cameras stand at one place, which leaves the size unknown",
            expected="cameras around the subject",
            got=f"{len(cameras)} centres within {spread:.3g}",
        )
    axes = np.concatenate([camera.rotation for camera in cameras])
    return np.concatenate([centred / spread, axes]), spread


def _turn(start: Floats, end: Floats) -> Floats:
    """(3, 3) the rotation, never a reflection, that takes one pattern onto the other."""
    left, _, right = np.linalg.svd(end.T @ start)
    sign = np.sign(np.linalg.det(left @ right))
    return np.asarray(left @ np.diag([1.0, 1.0, sign]) @ right, dtype=np.float64)


def _refuse_mirrored(start: Floats, end: Floats) -> None:
    """Refuse a mirrored world, in which cameras stay right-handed by turning their x axes round."""
    count = len(start) // 4
    # Without the x axes, whose sense no mirrored camera keeps.
    used = np.r_[0:count, [count + 3 * view + axis for view in range(count) for axis in (1, 2)]]
    start, end = start[used], end[used]
    left, _, right = np.linalg.svd(end.T @ start)
    free = left @ right
    if np.linalg.det(free) > 0:
        return
    turned = _rms(np.linalg.norm(start @ _turn(start, end).T - end, axis=1))
    mirrored = _rms(np.linalg.norm(start @ free.T - end, axis=1))
    if turned > _MIRROR_LEAST and mirrored < _MIRROR_SHARE * turned:
        raise MethodError(
            "the estimated cameras are a mirror image of the known ones",
            expected="cameras that a turn, a scale and a shift take onto the known ones",
            got=f"a residual of {turned:.3f}, and {mirrored:.3f} when mirrored",
            hint="Check the conventions of the source's cameras, and the order of the views",
        )


def _angles_deg(found: Sequence[Camera], known: Sequence[Camera], rotation: Floats) -> Floats:
    apart = [
        goal.rotation.T @ (own.rotation @ rotation.T)
        for own, goal in zip(found, known, strict=True)
    ]
    cosine = np.array([(np.trace(each) - 1.0) / 2.0 for each in apart])
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))
