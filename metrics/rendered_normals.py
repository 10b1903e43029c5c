"""Normals rendered from four sides, as ICON, ECON and their heirs compare them.

Their programs rasterise; here rays are cast through the pixels' centres. What a soft rasteriser
adds is modelled: its blur lets a face reach a part of a pixel beyond its outline, and its depth
blending lets surfaces behind thin limbs shine through. What faces next to a pixel's own add is
left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Literal

import numpy as np

from harness.core.arrays import Floats, Ints, Mask
from harness.core.protocol_stages import Pictures
from harness.geometry.surface import SurfaceIndex

_SIDE = 512
_YAWS_DEG = (0.0, 90.0, 180.0, 270.0)
#: A step in depth, in the frame's unit, beside which a face's reach beyond its outline shows.
_STEP = 0.005
#: Rays start so far, in the frame's unit, from the middle.
_FAR = 10.0


@dataclass(frozen=True, slots=True)
class Window:
    """What is seen: 2 units wide and high, about the vertical axis and a height.

    Attributes:
        middle_m: The height in the middle of the pictures, metres.
        per_metre: Units of the frame to a metre.
    """

    middle_m: float
    per_metre: float


def rendered_distance(predicted: Portraits, truth: Portraits, how: Pictures) -> float:
    """Mean squared difference of the rendered normals of two surfaces, over all pixels.

    Padding is alike on both sides, and counts in the mean.
    """
    total = 0.0
    for yaw_deg in _YAWS_DEG:
        mine, true = (each.picture(yaw_deg, how) for each in (predicted, truth))
        total += float(((mine - true) ** 2).sum())
    # The views lie side by side in one picture with padding around each.
    views = len(_YAWS_DEG)
    high, wide = _SIDE + 2 * how.padding, views * (_SIDE + how.padding) + how.padding
    return total / (high * wide)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What N rays meet: how deep, in the frame's unit, infinite where nothing; face and corners."""

    depth: Floats
    faces: Ints
    barycentric: Floats

    def of(self, chosen: Ints | Mask) -> _Seen:
        return _Seen(self.depth[chosen], self.faces[chosen], self.barycentric[chosen])

    def and_of(self, other: _Seen) -> _Seen:
        return _Seen(
            np.concatenate([self.depth, other.depth]),
            np.concatenate([self.faces, other.faces]),
            np.concatenate([self.barycentric, other.barycentric]),
        )


class Portraits:
    """Pictures of one surface (metres) in one window; what they have in common is made once."""

    def __init__(self, surface: SurfaceIndex, window: Window) -> None:
        self._surface, self._window = surface.smooth_at(seams=False), window
        self._seen = cache(self._look)
        self._blended = cache(self._blend)

    def picture(self, yaw_deg: float, how: Pictures) -> Floats:
        """(512, 512, 3) components of the normals seen from a side, and the background."""
        covered, normals = self._blended(yaw_deg, how.vertex_normals, how.blur, how.depth)
        if how.unit == "surface":
            normals = _unit(normals)
        image = np.full((_SIDE, _SIDE, 3), how.background)
        image[covered] = normals @ _axes(yaw_deg).T if how.axes == "view" else normals
        return _unit(image) if how.unit == "picture" else image

    def _blend(
        self, yaw_deg: float, weights: Literal["area", "angle"], blur: float, reach: float
    ) -> tuple[Mask, Floats]:
        """(512, 512) whether a surface is seen, and the (M, 3) interpolated normals there."""
        pixels, shift, seen = self._seen(yaw_deg, blur)
        values, corners = self._by_area if weights == "area" else self._by_angle
        covered = np.zeros((_SIDE, _SIDE), dtype=bool)
        if not reach:
            covered[tuple(pixels.T)] = True
            return covered, _weighted(values, corners[seen.faces], seen.barycentric)
        origins, away = self._origins(yaw_deg, pixels, shift), -_axes(yaw_deg)[2]
        ray, distance, faces, barycentric = self._surface.crossings(origins, away)
        blended = _weighted(values, corners[faces], barycentric)
        behind = distance * self._window.per_metre - seen.depth[ray]
        share = np.exp(-np.maximum(behind, 0.0) / reach)
        total = np.bincount(ray, share, len(origins))
        sums = [np.bincount(ray, share * axis, len(origins)) for axis in blended.T]
        met = total > 0
        covered[tuple(pixels[met].T)] = True
        return covered, (np.stack(sums, axis=1)[met] / total[met, None])

    def _look(self, yaw_deg: float, blur: float) -> tuple[Ints, Floats, _Seen]:
        """The (N, 2) pixels in which something is seen, where in each, and what.

        Beside an outline, a face that comes near enough to the pixel's centre counts.
        """
        if not blur:
            pixels = self._frame(yaw_deg)
            seen = self._cast(yaw_deg, pixels, np.zeros((len(pixels), 2)))
            met = np.isfinite(seen.depth)
            return pixels[met], np.zeros((int(met.sum()), 2)), seen.of(met)
        sharp, _, known = self._seen(yaw_deg, 0.0)
        # What is seen in each pixel, by its number: the nearest surface at first.
        which = np.full((_SIDE, _SIDE), -1)
        which[tuple(sharp.T)] = np.arange(len(sharp))
        image = np.append(known.depth, np.inf)[which]
        beside = np.stack(np.nonzero(_beside_steps(image)), axis=1)
        angles = np.arange(8) * np.pi / 4
        around = blur * np.stack([np.sin(angles), np.cos(angles)], axis=1)
        moved = np.repeat(around, len(beside), axis=0)
        found = self._cast(yaw_deg, np.tile(beside, (8, 1)), moved)
        for turn, depth in enumerate(found.depth.reshape(8, -1)):
            nearer = np.flatnonzero(depth < image[tuple(beside.T)] - _STEP)
            chosen = tuple(beside[nearer].T)
            image[chosen], which[chosen] = depth[nearer], len(sharp) + turn * len(beside) + nearer
        pixels = np.stack(np.nonzero(which >= 0), axis=1)
        chosen = which[tuple(pixels.T)]
        shift = np.concatenate([np.zeros((len(sharp), 2)), moved])[chosen]
        return pixels, shift, known.and_of(found).of(chosen)

    def _frame(self, yaw_deg: float) -> Ints:
        """(N, 2) row and column of the pixels around the surface, row by row."""
        corners = np.array(np.meshgrid(*self._surface.bounds.T)).reshape(3, -1).T
        across = (corners - self._middle) @ _axes(yaw_deg)[:2].T * self._window.per_metre
        across *= [1.0, -1.0]
        low, high = (
            np.clip(np.floor((end + 1.0) * _SIDE / 2) + step, 0, _SIDE).astype(int)
            for end, step in ((across.min(axis=0), -1), (across.max(axis=0), 2))
        )
        rows, columns = np.meshgrid(
            np.arange(low[1], high[1]), np.arange(low[0], high[0]), indexing="ij"
        )
        return np.stack([rows.ravel(), columns.ravel()], axis=1)

    @property
    def _middle(self) -> Floats:
        return np.array([0.0, self._window.middle_m, 0.0])

    def _origins(self, yaw_deg: float, pixels: Ints, shift: Floats) -> Floats:
        """(N, 3) where the rays of pixels start, each moved by a (N, 2) part of a pixel."""
        row, column = (pixels + 0.5 + shift).T * 2 / _SIDE - 1.0
        there = np.stack([column, -row, np.full(len(row), _FAR)], axis=1)
        return self._middle + (there / self._window.per_metre) @ _axes(yaw_deg)

    def _cast(self, yaw_deg: float, pixels: Ints, shift: Floats) -> _Seen:
        """What the rays of (N, 2) pixels meet first, each moved by a part of a pixel."""
        origins, count = self._origins(yaw_deg, pixels, shift), len(pixels)
        seen = _Seen(np.full(count, np.inf), np.zeros(count, np.int64), np.zeros((count, 3)))
        ray, distance, faces, barycentric = self._surface.crossings(
            origins, -_axes(yaw_deg)[2], first=True
        )
        seen.depth[ray] = distance * self._window.per_metre
        seen.faces[ray], seen.barycentric[ray] = faces, barycentric
        return seen

    @property
    def _by_area(self) -> tuple[Floats, Ints]:
        return self._surface.corner_normals

    @cached_property
    def _by_angle(self) -> tuple[Floats, Ints]:
        """(K, 3) smooth unit normals in which faces weigh by angle, and each corner's number."""
        mesh, group = self._surface.mesh, self._surface.corners
        first, second, third = (mesh.vertices[corner] for corner in mesh.faces.T)
        ahead = _unit(second - first), _unit(third - second), _unit(first - third)
        angles = [
            np.arccos(np.clip(-np.einsum("ij,ij->i", ahead[k], ahead[k - 1]), -1.0, 1.0))
            for k in range(3)
        ]
        count, normals = int(group.max()) + 1, _unit(self._surface.face_vectors)
        sums = [
            sum(np.bincount(group[:, k], angles[k] * axis, count) for k in range(3))
            for axis in normals.T
        ]
        return _unit(np.stack(sums, axis=1)), group


def _axes(yaw_deg: float) -> Floats:
    """(3, 3) rows: to the right, up, and towards the viewer, who stands at this yaw."""
    sin, cos = np.sin(np.radians(yaw_deg)), np.cos(np.radians(yaw_deg))
    return np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])


def _beside_steps(depth: Floats) -> Mask:
    """(H, W) whether a neighbour of a pixel is nearer by a step."""
    padded = np.pad(depth, 1, constant_values=np.inf)
    rows, columns = depth.shape
    nearest = np.min(
        [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0
    )
    return nearest < depth - _STEP


def _weighted(values: Floats, corners: Ints, weights: Floats) -> Floats:
    """(N, 3) sums of the values at (N, 3) corners."""
    return np.einsum("nk,nkc->nc", weights, values[corners])


def _unit(vectors: Floats) -> Floats:
    lengths = np.sqrt(np.einsum("...k,...k->...", vectors, vectors))[..., None]
    return vectors / np.where(lengths > 0, lengths, 1.0)
