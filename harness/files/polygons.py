"""Polygons become triangles, alike in every format: fans where these stay inside, else ears."""

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import AnyInts, Floats, Ints
from harness.core.errors import DataError

#: Of a size: less is rounding, for coordinates are written with about seven digits.
_FLAT = 1e-7
#: Polygons with notches take a time that grows with the square of their corners.
_MOST_NOTCHED = 2000


def cut_polygons(vertices: Floats, corners: AnyInts, counts: Ints) -> Ints:
    """(T, 3) places in ``corners`` of the triangles that polygons are cut into, in their order.

    A polygon is seen along the normal of Newell's plane. It is a fan from its first corner where
    that stays inside, as in all convex ones, else from its deepest notch, else cut ear by ear. The
    time grows with the corners, but for those that are cut by ears.

    Args:
        vertices: (V, 3) positions.
        corners: (C,) vertex indices of all polygons, one after the other.
        counts: (P,) how many corners each has, at least 3.

    Raises:
        DataError: a polygon that crosses itself, or one with notches and too many corners.
    """
    if (counts == 3).all():
        return np.arange(len(corners)).reshape(-1, 3)
    starts, fans = np.cumsum(counts) - counts, counts - 2
    firsts = np.cumsum(fans) - fans
    apex = np.zeros(len(counts), np.int64)
    notched: list[int] = []
    # An index out of range is refused where the mesh is made.
    if corners.min() >= 0 and corners.max() < len(vertices):
        for count in np.unique(counts[counts > 3]):
            chosen = np.flatnonzero(counts == count)
            places: Ints = starts[chosen, None] + np.arange(int(count))
            apex[chosen], is_fan = _fans(vertices[corners[places]])
            notched += chosen[~is_fan].tolist()
    step = np.arange(int(fans.sum())) - np.repeat(firsts, fans)
    places = np.repeat(apex, fans)[:, None] + np.stack([0 * step, step + 1, step + 2], axis=1)
    triangles = np.repeat(starts, fans)[:, None] + places % np.repeat(counts, fans)[:, None]
    for face in notched:
        start, count, first = starts[face], int(counts[face]), firsts[face]
        try:
            found = _ears(_flattened(vertices[corners[start : start + count]][None])[0])
        except ValueError as error:
            raise DataError(
                f"face {face + 1}, of {count} corners, {error}",
                expected=f"polygons with one plain outline, or up to {_MOST_NOTCHED} corners",
                hint="Triangulate the mesh in the program that made it",
            ) from error
        triangles[first : first + fans[face]] = start + found
    return triangles


def _cross(a: Floats, b: Floats) -> Floats:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _flattened(polygons: Floats) -> Floats:
    """(n, k, 2) polygons (n, k, 3) in Newell's planes, counter-clockwise; zero if there is none."""
    arms = polygons - polygons.mean(axis=1, keepdims=True)
    x, y, z = np.moveaxis(arms, 2, 0)
    after_x, after_y, after_z = np.moveaxis(np.roll(arms, -1, axis=1), 2, 0)
    parts = (y * after_z - z * after_y, z * after_x - x * after_z, x * after_y - y * after_x)
    normal = np.stack([part.sum(axis=1) for part in parts], axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    size = np.square(arms).sum(axis=2).max(axis=1)[:, None]
    normal = np.where(length > _FLAT * size, normal / np.where(length > 0, length, 1.0), 0.0)
    right = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 0.5)
    axes = right, np.cross(normal, right)
    # numpy 1's own annotation of einsum is not whole.
    flat = [
        np.einsum("nkj,nj->nk", arms, axis)  # pyright: ignore[reportUnknownMemberType]
        for axis in axes
    ]
    return np.stack(flat, axis=-1)


def _fans(polygons: Floats) -> tuple[Ints, NDArray[np.bool_]]:
    """(n,) the corner from which each polygon (n, k, 3) is a fan, and whether there is one."""
    apex = np.zeros(len(polygons), np.int64)
    corner: Ints = np.arange(int(polygons.shape[1]), dtype=np.int64)
    with np.errstate(all="ignore"):
        flat = _flattened(polygons)
        is_fan = _is_fan(flat)
        if not is_fan.all():
            others = np.flatnonzero(~is_fan)
            deepest: Ints = _turns(flat[others]).argmin(axis=1)
            apex[others] = deepest
            order: Ints = np.add.outer(deepest, corner) % len(corner)
            is_fan[others] = _is_fan(np.take_along_axis(flat[others], order[..., None], axis=1))
            # Along a line there is no plane, and no area to lose; nor is there without numbers.
            arms = polygons[others, 1:] - polygons[others, :1]
            areas = np.linalg.norm(np.cross(arms[:, :-1], arms[:, 1:]), axis=2).sum(axis=1)
            size = np.square(arms).sum(axis=2).max(axis=1)
            is_fan[others] |= ~np.isfinite(areas) | (areas <= _FLAT * size)
    return apex, is_fan


def _turns(flat: Floats) -> Floats:
    """(n, k) by how much polygons (n, k, 2) turn to the left at each corner, in radians."""
    sides = np.roll(flat, -1, axis=1) - flat
    before = np.roll(sides, 1, axis=1)
    along = np.einsum("nkj,nkj->nk", before, sides)  # pyright: ignore[reportUnknownMemberType]
    return np.arctan2(_cross(before, sides), along)


def _is_fan(flat: Floats) -> NDArray[np.bool_]:
    """(n,) whether polygons (n, k, 2) are fans from their first corners."""
    arms = flat[:, 1:] - flat[:, :1]
    areas = _cross(arms[:, :-1], arms[:, 1:])
    # A corner may lie to the wrong side of an arm by what its coordinates are rounded.
    least = -_FLAT * np.abs(flat).max(axis=(1, 2))[:, None] * np.abs(arms).sum(axis=2)[:, 1:]
    is_fan = flat.any(axis=(1, 2)) & (areas >= least).all(axis=1)
    if flat.shape[1] > 4:
        # Those that wind twice have no triangle that is turned over either.
        is_fan &= _turns(flat).sum(axis=1) < 3 * np.pi
    return is_fan


def _ears(flat: Floats) -> list[tuple[int, int, int]]:
    """The triangles of one polygon (k, 2), counter-clockwise.

    Raises:
        ValueError: it crosses itself, or is too long.
    """
    if len(flat) > _MOST_NOTCHED:
        raise ValueError("has notches")
    if _crosses(flat):
        raise ValueError("crosses itself")
    left = list(range(len(flat)))
    triangles: list[tuple[int, int, int]] = []
    at = passed = 0
    while len(left) > 3:
        at %= len(left)
        ear = (left[at - 1], left[at], left[(at + 1) % len(left)])
        # Without an ear, what is left is a line to and fro, in which any corner can go.
        if passed >= len(left) or _is_ear(flat, ear, left):
            triangles.append(ear)
            del left[at]
            at, passed = max(at - 1, 0), 0
        else:
            at, passed = at + 1, passed + 1
    return [*triangles, (left[0], left[1], left[2])]


def _is_ear(flat: Floats, ear: tuple[int, int, int], left: list[int]) -> bool:
    a, b, c = flat[list(ear)]
    if _cross(b - a, c - b) < 0:
        return False
    others = flat[left]
    inside = np.ones(len(left), dtype=bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= (_cross(end - start, others - start) >= 0) & (others != start).any(axis=1)
    return not inside.any()


def _crosses(flat: Floats) -> bool:
    """Whether any two sides of a polygon cross, or it has no area."""
    sides = np.roll(flat, -1, axis=0) - flat
    # How far each corner lies to the left of each side.
    left = _cross(sides[:, None], flat[None] - flat[:, None])
    left[np.abs(left) <= 1e-9 * np.abs(sides).sum(axis=1)[:, None] * np.abs(flat).max()] = 0.0
    parted = left * np.roll(left, -1, axis=1) < 0
    return not flat.any() or bool((parted & parted.T).any())
