"""Whether photos and cameras belong together: the visual hull, seen again in each photo.

Every silhouette is at least as large as the hull's, which is what all silhouettes share. Where
cameras and photos belong together the two are nearly the same; where photos are mirrored or
exchanged, or poses are of another convention, the hull loses limbs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.core.arrays import Bytes, Floats, Mask
from harness.core.camera import Camera, rigid_inverse
from harness.core.errors import DataError, MethodError
from harness.geometry.images import resampled
from harness.geometry.outline import Outline
from harness.geometry.place import MEAN_HEIGHT_M, place_of
from harness.geometry.raycast import Raycaster
from harness.photos.world import up_of_cameras, upright
from methods.hull import HullSettings, hull_of

#: Silhouettes are compared on pictures of at most this many pixels along the longer side.
_COMPARED_PX = 640
_TRIED_PX = 160
#: Edge of the hull's voxels where the person is of mean height, metres.
_VOXEL_M, _TRIED_VOXEL_M = 0.008, 0.024
#: Another reading of the cameras is named where it agrees better by so much, and well; all that are
#: so close to the best are named.
_BETTER, _WELL, _TIED = 0.03, 0.90, 0.01
#: A mask is odd if without it the others lose so much less of an IoU of 1 each, together, and agree
#: so well in the mean. With fewer others none can be told.
_LOST, _RESTORED, _LEAST_OTHERS = 0.1, 0.95, 3


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """How well silhouettes and cameras agree.

    Attributes:
        iou: (N,) of each photo's mask and the hull's; 0 for all where there is no hull.
        bounds: (2, 3) of the hull in the cameras' world and unit; None where there is no hull.
        reason: Why there is none; else empty.
    """

    iou: tuple[float, ...]
    bounds: Floats | None
    reason: str = ""

    @property
    def mean(self) -> float:
        """The mean over the photos."""
        return float(np.mean(self.iou))


@dataclass(frozen=True, slots=True)
class OtherReading:
    """Another reading of a camera file.

    Attributes:
        name: What would have to be so, in words.
        iou: How well photos and cameras agree then, roughly.
    """

    name: str
    iou: float


def hull_agreement(
    cameras: Sequence[Camera],
    coverages: Sequence[Bytes],
    *,
    coarse: bool = False,
) -> Agreement:
    """How well masks (H, W) uint8 agree with their cameras, of which the world has +Y up.

    Args:
        cameras: One for each mask, in any unit of length.
        coverages: The masks.
        coarse: Whether a rough answer is enough.
    """
    try:
        compared = _Compared.of(cameras, coverages, coarse=coarse)
    except (MethodError, DataError, ValueError) as error:
        return Agreement((0.0,) * len(cameras), None, str(error))
    return compared.agreement()


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """Silhouettes on small pictures, in metres of a person of mean height, and the hull's voxels.

    So the voxels are of a known size. What an outline computes is kept from hull to hull.
    """

    outlines: list[Outline]
    share: float
    voxel_m: float

    @classmethod
    def of(
        cls, cameras: Sequence[Camera], coverages: Sequence[Bytes], *, coarse: bool
    ) -> _Compared:
        longest, voxel_m = (_TRIED_PX, _TRIED_VOXEL_M) if coarse else (_COMPARED_PX, _VOXEL_M)
        outlines = [_smaller(c, m, longest) for c, m in zip(cameras, coverages, strict=True)]
        share = MEAN_HEIGHT_M / (2 * place_of(outlines).half_height_m)
        scaled = [replace(o, camera=_scaled(o.camera, share)) for o in outlines]
        return cls(scaled, share, voxel_m)

    def agreement(self, without: Collection[int] = ()) -> Agreement:
        """Of all silhouettes with the hull of those that are not left out."""
        used = [outline for view, outline in enumerate(self.outlines) if view not in without]
        try:
            mesh = hull_of(used, HullSettings(voxel_m=self.voxel_m))
        # The contour of a hull that is thinner than its voxels is no surface to scikit-image.
        except (MethodError, DataError, RuntimeError, ValueError) as error:
            return Agreement((0.0,) * len(self.outlines), None, str(error))
        caster = Raycaster(mesh)
        iou = tuple(_iou(outline.mask, caster.mask(outline.camera)) for outline in self.outlines)
        return Agreement(iou, mesh.bounds / self.share)


def odd_views(cameras: Sequence[Camera], coverages: Sequence[Bytes]) -> dict[int, float]:
    """The masks that do not agree with those of all others, and their IoU with the others' hull.

    One mask that is too small takes from the hull in every photo, so the mean and the worst photo
    do not tell which it is. It is the one without which the others agree far better.

    Args:
        cameras: Of which the world has +Y up.
        coverages: The masks.
    """
    compared = _Compared.of(cameras, coverages, coarse=True)

    def lost(*without: int) -> float:
        iou = compared.agreement(without).iou
        return sum(1 - value for view, value in enumerate(iou) if view not in without)

    odd: list[int] = []
    now = lost()
    while len(cameras) - len(odd) > _LEAST_OTHERS and now > _LOST:
        rest = {view: lost(*odd, view) for view in range(len(cameras)) if view not in odd}
        worst = min(rest, key=lambda view: rest[view])
        if np.median(list(rest.values())) - rest[worst] < _LOST:
            break
        odd.append(worst)
        now = rest[worst]
    if now > (1 - _RESTORED) * (len(cameras) - len(odd)):
        return {}
    iou = compared.agreement(odd).iou
    return {view: iou[view] for view in odd}


def other_reading(
    cameras: Sequence[Camera], coverages: Sequence[Bytes], present: float
) -> OtherReading | None:
    """A reading of the same file under which photos and cameras agree better; None without one.

    Args:
        cameras: In the file's world; up is where the cameras of each reading tell.
        coverages: The masks.
        present: How well they agree as read.
    """
    found = [
        OtherReading(name, _agrees(*read(list(cameras), list(coverages))))
        for name, read in _READINGS.items()
    ]
    best = max(reading.iou for reading in found)
    if best < max(present + _BETTER, _WELL):
        return None
    # In an even ring, silhouettes do not tell mirrored photos from the opposite order.
    names = [reading.name for reading in found if reading.iou > best - _TIED]
    return OtherReading(", or ".join(names), best)


def _agrees(cameras: list[Camera], coverages: list[Bytes]) -> float:
    world = upright(up_of_cameras(cameras))
    return hull_agreement([world.camera(c) for c in cameras], coverages, coarse=True).mean


Reading = Callable[[list[Camera], list[Bytes]], tuple[list[Camera], list[Bytes]]]


def _mirrored(cameras: list[Camera], masks: list[Bytes]) -> tuple[list[Camera], list[Bytes]]:
    return cameras, [np.ascontiguousarray(mask[:, ::-1]) for mask in masks]


def _other_axes(cameras: list[Camera], masks: list[Bytes]) -> tuple[list[Camera], list[Bytes]]:
    return [camera.turned(np.diag([1.0, -1.0, -1.0])) for camera in cameras], masks


def _inverse(cameras: list[Camera], masks: list[Bytes]) -> tuple[list[Camera], list[Bytes]]:
    return [
        replace(camera, world_to_camera=rigid_inverse(camera.world_to_camera)) for camera in cameras
    ], masks


def _backwards(cameras: list[Camera], masks: list[Bytes]) -> tuple[list[Camera], list[Bytes]]:
    # The first photo stays the first: a ring that was numbered the other way round.
    return cameras, [masks[0], *masks[:0:-1]]


_READINGS: dict[str, Reading] = {
    "the photos are mirrored": _mirrored,
    "the poses are of cameras that look along +z with y down, not along -z with y up, or the other "
    "way round": _other_axes,
    "the poses are the inverse of what this format has": _inverse,
    "the photos are in the opposite order": _backwards,
}


def _smaller(camera: Camera, coverage: Bytes, longest_px: int) -> Outline:
    share = min(1.0, longest_px / max(camera.size))
    size = (max(1, round(share * camera.width)), max(1, round(share * camera.height)))
    small = np.round(255 * resampled(coverage / 255.0, size, "box")) / 255
    return Outline(camera.resized(*size), small)


def _scaled(camera: Camera, share: float) -> Camera:
    pose = camera.world_to_camera.copy()
    pose[:3, 3] *= share
    return replace(camera, world_to_camera=pose)


def _iou(mask: Mask, other: Mask) -> float:
    union = int((mask | other).sum())
    return int((mask & other).sum()) / union if union else 0.0
