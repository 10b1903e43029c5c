"""One normal map to one depth map."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import label

from harness.core.arrays import Floats, Mask
from harness.core.errors import DataError
from harness.geometry.window import Window
from methods.surface.bilateral import Equations, Schedule, integrate

# An 8-bit map is off by up to 0.007; a map left in [0, 1] or interpolated across an edge by more.
_UNIT_TOLERANCE = 0.02


def integrate_normals(
    normals: ArrayLike,
    mask: ArrayLike,
    K: ArrayLike | None = None,
    k: float = 2.0,
    max_iter: int = 100,
    tol: float = 1e-4,
) -> Floats:
    """Depth (H, W) whose surface has the given normals, jumps kept; NaN outside the mask.

    Depth grows away from the viewer. Without ``K`` the view is orthographic and depth is in pixels,
    with mean 0. With ``K`` it is perspective and depth is along the optical axis; its scale cannot
    be known from normals, and the geometric mean is 1. Parts of the mask that do not touch (by
    pixel sides) are not related by their normals: each has that mean of its own.

    Args:
        normals: (H, W, 3) unit normals, x right, y up, z towards the viewer; read inside the mask.
        mask: (H, W) boolean or integer, nonzero on the surface.
        K: (3, 3) intrinsics in pixels; the centre of the top-left pixel is (0.5, 0.5).
        k: Sharpness of the bilateral weights; higher finds more jumps.
        max_iter: Most rounds of reweighting.
        tol: Relative change of energy that ends them.

    Raises:
        DataError: shapes that do not match, an empty mask, normals that are not finite unit
            vectors, a K that is not one, parameters out of range.

    Source: Cao, Santo, Shi, Okura, Matsushita, "Bilateral Normal Integration", ECCV 2022. The
    published pixel index counts from 0 at the top-left centre; add 0.5 to such principal points.
    """
    mask = checked_mask(mask)
    normals = checked_normals(normals, mask)
    intrinsics = None if K is None else checked_intrinsics(K)
    if not (k > 0 and tol > 0 and max_iter >= 1):
        raise DataError(
            "normal integration cannot run with these parameters",
            expected="k > 0, tol > 0, max_iter >= 1",
            got=f"k={k}, tol={tol}, max_iter={max_iter}",
        )
    rows, columns = Window.around(mask).slices
    window = mask[rows, columns]
    planes = tangent_planes(normals[rows, columns], window, (rows.start, columns.start), intrinsics)
    values, _ = integrate(_on_lattice(planes), Schedule(k, max_iter, tol))
    values = _centred(values[: window.shape[0], : window.shape[1]], window)
    if intrinsics is not None:
        values = np.exp(values / focal_length(intrinsics))
    depth = np.full(mask.shape, np.nan)
    depth[rows, columns] = np.where(window, values, np.nan)
    return depth


def tangent_planes(
    normals: Floats, mask: Mask, origin: tuple[int, int], K: Floats | None
) -> Equations:
    """The tangent-plane equations of a window (H, W) whose top-left pixel is (row, column) origin.

    The unknown is depth in pixels without ``K``. With it, the unknown is the focal length times
    log depth: with n the normal and r the ray of unit depth, ``n.r d(log z)/du + n_x / f = 0``
    (BiNI section 3), multiplied by f. A step of that unknown is a step of depth in pixels at the
    depth of the surface, so that weights and priors mean the same in both views.
    """
    height, width = mask.shape
    n_x, n_y, n_z = (np.where(mask, component, 0.0) for component in np.moveaxis(normals, -1, 0))
    slope_x, slope_y, along_axis = n_x, -n_y, -n_z  # the camera's x right, y down, z forward
    if K is None:
        return Equations(mask, along_axis, along_axis, slope_x, slope_y)
    ray_x = (np.arange(width) + origin[1] + 0.5 - K[0, 2]) / K[0, 0]
    ray_y = (np.arange(height) + origin[0] + 0.5 - K[1, 2]) / K[1, 1]
    facing = slope_x * ray_x + slope_y * ray_y[:, None] + along_axis
    focal = focal_length(K)
    return Equations(mask, facing * (K[0, 0] / focal), facing * (K[1, 1] / focal), slope_x, slope_y)


def focal_length(K: Floats) -> float:
    """The geometric mean of the two focal lengths, in pixels."""
    return float(np.sqrt(K[0, 0] * K[1, 1]))


def _on_lattice(planes: Equations) -> Equations:
    """The equations padded to an odd number of columns and an even number of rows."""
    height, width = planes.inside.shape
    padding = ((0, height % 2), (0, 1 - width % 2))
    return planes.rearranged(lambda array: np.pad(array, padding))


def _centred(values: Floats, mask: Mask) -> Floats:
    """Values with the mean of every connected part at zero."""
    parts = np.zeros(mask.shape, dtype=np.int32)
    count = int(label(mask, output=parts))  # type: ignore[arg-type]
    totals = np.bincount(parts.ravel(), weights=values.ravel(), minlength=count + 1)
    means = totals / np.maximum(np.bincount(parts.ravel(), minlength=count + 1), 1)
    return values - means[parts]


def checked_mask(mask: ArrayLike) -> Mask:
    """The mask as booleans (H, W); DataError unless it is one and has a pixel."""
    array = np.asarray(mask)
    if array.ndim != 2 or array.dtype.kind not in "bui":
        raise DataError(
            "the mask of a normal map is not usable",
            expected="a boolean or integer image (H, W)",
            got=f"{array.dtype} of shape {array.shape}",
        )
    if not array.any():
        raise DataError(
            "the mask of a normal map is empty",
            expected="at least one pixel on the surface",
            got=f"none of {array.size}",
            hint="Look at the silhouette that was handed in",
        )
    return array.astype(bool)


def checked_normals(normals: ArrayLike, mask: Mask, name: str = "normal map") -> Floats:
    """The normals (H, W, 3) as float64; DataError unless finite and unit inside the mask."""
    array = np.asarray(normals, dtype=np.float64)
    if array.shape != (*mask.shape, 3):
        raise DataError(
            f"{name} and mask do not match",
            expected=f"normals of shape {(*mask.shape, 3)}",
            got=str(array.shape),
        )
    length = np.linalg.norm(array[mask], axis=1)
    wrong = ~(np.abs(length - 1.0) <= _UNIT_TOLERANCE)
    if wrong.any():
        row, column = (int(index[wrong][0]) for index in np.nonzero(mask))
        raise DataError(
            f"{name} has {int(wrong.sum())} pixels in the mask that are no unit vector",
            expected=f"length 1 within {_UNIT_TOLERANCE}",
            got=f"{array[row, column]} at row {row}, column {column}",
            hint="Decode the map to [-1, 1] and normalise it, or take those pixels out of the mask",
        )
    return array


def checked_intrinsics(K: ArrayLike) -> Floats:
    """The intrinsics (3, 3) as float64; DataError unless finite with positive focal lengths."""
    array = np.asarray(K, dtype=np.float64)
    good = array.shape == (3, 3) and bool(np.isfinite(array).all())
    if not good or array[0, 0] <= 0 or array[1, 1] <= 0 or array[0, 1] != 0:
        raise DataError(
            "K is not an intrinsic matrix that normals can be integrated with",
            expected="finite (3, 3), positive focal lengths, no skew",
            got=np.array2string(array) if array.size <= 9 else f"shape {array.shape}",
        )
    return array
