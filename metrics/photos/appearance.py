"""How a coloured mesh looks beside the photos: from all of them, and with one left out in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.formats.coloured_mesh import ColouredMesh
from harness.core.mesh import Mesh
from harness.core.quality.photo_scores import Likeness, ViewScore
from harness.geometry.colours.colouring import Colouring
from harness.geometry.colours.detail import finer
from harness.geometry.images import linear_from_srgb, srgb_from_linear
from harness.geometry.photo import Photo
from harness.geometry.raycast import Raycaster
from harness.geometry.window import Window
from metrics.body import silhouette_iou
from metrics.photos.likeness import likeness

#: Colours lie on vertices about this far apart, or 1.5 pixels where these are larger, whatever the
#: mesh's own triangles.
EDGE_M, _EDGE_PIXELS = 0.004, 1.5
#: The mesh is not made finer than so many vertices.
_MOST_VERTICES = 250_000
#: So many photos are left out in turn, evenly spread; fewer than three photos leave none.
MOST_HELD_OUT = 4
_LEAST_PHOTOS = 3
#: Darker pixels, in linear light, say nothing of the exposure.
_DARK = 0.02


@dataclass(frozen=True, slots=True)
class Appearance:
    """Attributes:
    views: One for each photo.
    seen_share: Share of the coloured vertices that a photo shows.
    """

    views: tuple[ViewScore, ...]
    seen_share: float


def appearance(mesh: Mesh, photos: Sequence[Photo], edge_m: float = EDGE_M) -> Appearance:
    """Silhouette and likeness of a mesh in every photo.

    A pixel belongs to the mesh where the ray through its centre meets it, and to the photo's
    subject where its coverage is at least one half. Before two pictures are compared the rendered
    one is brought to the photo's exposure by one factor a channel, because a mesh has one exposure
    and photos may have several.

    Args:
        mesh: World metres.
        photos: Counted from the front.
        edge_m: How far apart the coloured vertices are at least, about.
    """
    fine = finer(mesh, max(edge_m, _EDGE_PIXELS * _pixel_m(mesh, photos)), _MOST_VERTICES)
    colouring = Colouring(fine, photos)
    every = range(len(photos))
    from_all = colouring.from_photos(every)
    left_out = _left_out(len(photos))
    views: list[ViewScore] = []
    for index, photo in enumerate(photos):
        others = [other for other in every if other != index]
        compared = [from_all]
        if index in left_out:
            compared.append(colouring.from_photos(others))
        iou, found = _compared(photo, colouring.caster, compared)
        views.append(ViewScore(index, iou, found[0], found[1] if len(found) > 1 else None))
    return Appearance(tuple(views), from_all.seen_share)


def _pixel_m(mesh: Mesh, photos: Sequence[Photo]) -> float:
    """What a pixel spans at the middle of the mesh, in the photo that shows it largest."""
    middle = mesh.bounds.mean(axis=0)
    return min(
        float(np.linalg.norm(photo.camera.position - middle)) / photo.camera.K[0, 0]
        for photo in photos
    )


def _left_out(count: int) -> set[int]:
    """Which of some photos are left out, in turn."""
    if count < _LEAST_PHOTOS:
        return set()
    wanted = min(count, MOST_HELD_OUT)
    return {index * count // wanted for index in range(wanted)}


def _compared(
    photo: Photo, caster: Raycaster, meshes: Sequence[ColouredMesh]
) -> tuple[float, list[Likeness | None]]:
    """The silhouette's IoU in a photo, and how alike each coloured mesh is to it."""
    covered = caster.mask(photo.camera)
    iou = silhouette_iou(covered, photo.mask)
    if not (covered & photo.mask).any():
        return iou, [None] * len(meshes)
    # No pixel beside both masks is compared.
    photo = photo.cropped(Window.around(covered & photo.mask))
    hits = caster.cast(photo.camera)
    both = hits.mask & photo.mask
    shown = photo.rgba[..., :3] / 255.0
    found: list[Likeness | None] = []
    for coloured in meshes:
        picture = hits.interpolate(coloured.colours / 255.0, caster.mesh.faces)
        picture[both] = in_exposure_of(picture[both], shown[both])
        found.append(likeness(picture, shown, both))
    return iou, found


def in_exposure_of(colours: Floats, photo: Floats) -> Floats:
    """(N, 3) sRGB colours times one factor a channel of linear light: the median of the ratios.

    Args:
        colours: (N, 3) sRGB in [0, 1].
        photo: (N, 3) likewise, of the same pixels.
    """
    ours, theirs = linear_from_srgb(colours), linear_from_srgb(photo)
    for channel in range(3):
        bright = (ours[:, channel] > _DARK) & (theirs[:, channel] > _DARK)
        if bright.any():
            ours[:, channel] *= np.median(theirs[bright, channel] / ours[bright, channel])
    return np.asarray(srgb_from_linear(np.clip(ours, 0.0, 1.0)))
