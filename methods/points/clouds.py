"""A cloud of points to what a surface is made through: chosen, and facing outwards."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.errors import MethodError
from harness.core.results import PointCloud
from harness.geometry.photo import Photo
from methods.points.cloud import OrientedPoints
from methods.points.filtering import KeepSettings, Kept, refuse_nothing
from methods.points.splats import directions

#: A point beside a mask by more than this is not the subject's, pixels.
_BESIDE_PX = 2
#: Points that sides are looked at from, and how many of the cloud's own are looked at.
_LOOKS, _LOOKED_AT = 42, 20_000
#: Where they stand, and how large the sphere is that points are mirrored at: sizes of the cloud.
_AWAY, _MIRROR = 3.0, 100.0


def kept_cloud(cloud: PointCloud, photos: Sequence[Photo], settings: KeepSettings) -> Kept:
    """The points of a cloud that are the subject's, with normals.

    The steps: ``mask`` (beside no photo's mask), ``outliers`` (about as near to others as these are
    to each other), ``normals`` (the cloud's own, or those that face who sees them).

    Args:
        cloud: World metres where there are photos.
        photos: What was photographed; none skips the first step.
        settings: Of which the neighbours of outliers count.

    Raises:
        MethodError: a step leaves nothing.
    """
    positions, normals = cloud.positions.astype(np.float64), cloud.normals
    inside = np.ones(len(positions), dtype=bool)
    for photo in photos:
        inside &= _in_mask(positions, photo)
    shares = {"mask": float(inside.mean())}
    index = np.flatnonzero(inside)
    near = _near_as_others(positions[index], settings)
    shares["outliers"] = float(near.mean()) if len(near) else 0.0
    index = index[near]
    refuse_nothing(shares)
    chosen = positions[index]
    lengths = None if normals is None else np.linalg.norm(normals[index], axis=1)
    if normals is not None and lengths is not None and (lengths > 0).all():
        found = normals[index] / lengths[:, None]
    else:
        found = outward_normals(chosen, settings.outlier_neighbours)
    return Kept(OrientedPoints(chosen, found), shares, (len(index) / len(positions),))


def _in_mask(points: Floats, photo: Photo) -> Mask:
    """(N,) which points a photo does not show beside its mask."""
    from scipy.ndimage import binary_dilation

    mask = np.asarray(binary_dilation(photo.coverage > 0, iterations=_BESIDE_PX), dtype=bool)
    pixels, _ = photo.camera.project(points)
    with np.errstate(invalid="ignore"):
        framed = ((pixels >= 0) & (pixels < photo.camera.size)).all(axis=1)
    columns, rows = pixels[framed].astype(np.int64).T
    found = np.ones(len(points), dtype=bool)
    found[framed] = mask[rows, columns]
    return found


def _near_as_others(points: Floats, settings: KeepSettings) -> Mask:
    """(N,) which points are about as near to their neighbours as these are to theirs."""
    count = settings.outlier_neighbours
    if settings.outlier_spacing == 0 or len(points) <= count + 1:
        return np.ones(len(points), dtype=bool)
    distance, nearest = _neighbours(points, count)
    own = distance.mean(axis=1)
    return own <= settings.outlier_spacing * np.median(own[nearest], axis=1)


def _neighbours(points: Floats, count: int) -> tuple[Floats, Ints]:
    from scipy.spatial import KDTree

    # Its annotations have one number for many.
    found: Any = KDTree(points).query(points, k=count + 1, workers=-1)
    distance, nearest = found
    return distance[:, 1:], nearest[:, 1:]


def outward_normals(points: Floats, neighbours: int = 16) -> Floats:
    """(N, 3) unit normals of the planes through neighbours, towards the sides that see them.

    What a side sees is on the convex hull of the points mirrored at a sphere about the viewer
    (Katz, Tal and Basri, "Direct visibility of point sets", TOG 2007).

    Raises:
        MethodError: too few points, or points on one plane.
    """
    from scipy.spatial import ConvexHull, KDTree, QhullError

    if len(points) <= neighbours:
        raise MethodError("too few points for normals", got=str(len(points)))
    around = points[_neighbours(points, neighbours)[1]]
    spread = around - around.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]
    step = max(1, len(points) // _LOOKED_AT)
    some, own = points[::step], normals[::step]
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    size = 2 * float(np.linalg.norm(points - centre, axis=1).max())
    votes = np.zeros(len(some))
    for way in directions(_LOOKS):
        towards = centre + _AWAY * size * way - some
        length = np.linalg.norm(towards, axis=1, keepdims=True)
        mirrored = -towards * (2 * _MIRROR * size / length - 1)
        try:
            hull = ConvexHull(np.concatenate([mirrored, np.zeros((1, 3))])).vertices
        except QhullError as error:
            raise MethodError("the points are on one plane", expected="a surface") from error
        seen = hull[hull < len(some)]
        votes[seen] += np.einsum("ni,ni->n", own[seen], (towards / length)[seen])
    sure = np.flatnonzero(votes)
    facing = own[sure] * np.sign(votes[sure])[:, None]
    leader = KDTree(some[sure]).query(points, workers=-1)[1]
    side = np.sign(np.einsum("ni,ni->n", normals, facing[leader]))
    return np.asarray(normals * np.where(side == 0, 1.0, side)[:, None], dtype=np.float64)
