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
from harness.geometry.surface import SurfaceIndex, blend

_SIDE = 512
_YAWS_DEG, _HALF_TURN_DEG = (0.0, 90.0, 180.0, 270.0), 180.0
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
    background = np.full((1, 3), how.background)
    background = _unit(background) if how.unit == "picture" else background
    total = 0.0
    for yaw_deg in _YAWS_DEG:
        pictures = [each.picture(yaw_deg, how) for each in (predicted, truth)]
        # Where neither shows anything the two are alike.
        shown = np.zeros(_SIDE * _SIDE, dtype=bool)
        for pixels, _ in pictures:
            shown[pixels] = True
        place = np.cumsum(shown) - 1
        mine, true = (np.repeat(background, int(shown.sum()), axis=0) for _ in pictures)
        for values, (pixels, normals) in zip((mine, true), pictures, strict=True):
            values[place[pixels]] = normals
        mine -= true
        total += float(np.einsum("ij,ij->", mine, mine))
    # The views lie side by side in one picture with padding around each.
    views = len(_YAWS_DEG)
    high, wide = _SIDE + 2 * how.padding, views * (_SIDE + how.padding) + how.padding
    return total / (high * wide)


@dataclass(frozen=True, slots=True, eq=False)
class _Met:
    """N places where rays meet the surface.

    Attributes:
        ray: (N,) which ray; those of one ray are beside each other.
        depth: (N,) how far from its start, in the frame's unit.
        faces: (N,) the face.
        barycentric: (N, 3) weights of its corners.
    """

    ray: Ints
    depth: Floats
    faces: Ints
    barycentric: Floats

    def of(self, chosen: Ints | Mask, ray: Ints | None = None) -> _Met:
        """Some of them, by the rays' own numbers or others."""
        ray = self.ray[chosen] if ray is None else ray
        return _Met(ray, self.depth[chosen], self.faces[chosen], self.barycentric[chosen])

    def and_of(self, other: _Met) -> _Met:
        return _Met(
            np.concatenate([self.ray, other.ray]),
            np.concatenate([self.depth, other.depth]),
            np.concatenate([self.faces, other.faces]),
            np.concatenate([self.barycentric, other.barycentric]),
        )

    def nearest(self) -> _Met:
        """The first one of each ray."""
        starts = np.flatnonzero(np.diff(self.ray, prepend=-1))
        counts = np.diff(starts, append=len(self.ray))
        if not len(starts):
            return self
        least = np.repeat(np.minimum.reduceat(self.depth, starts), counts)
        first = np.flatnonzero(self.depth == least)
        return self.of(first[np.diff(self.ray[first], prepend=-1) != 0])


class Portraits:
    """Pictures of one surface (metres) in one window; what they have in common is made once.

    Pixels are numbered row by row.
    """

    def __init__(self, surface: SurfaceIndex, window: Window) -> None:
        self._surface, self._window = surface.smooth_at(seams=False), window
        self._lines = cache(self._met_by_lines)
        self._seen = cache(self._look)
        self._blended = cache(self._blend)

    def picture(self, yaw_deg: float, how: Pictures) -> tuple[Ints, Floats]:
        """The (M,) pixels that show something from a side, and the (M, 3) normals there."""
        pixels, normals = self._blended(yaw_deg, how.vertex_normals, how.blur, how.depth)
        if how.unit != "none":
            normals = _unit(normals)
        return pixels, normals @ _axes(yaw_deg).T if how.axes == "view" else normals

    def _blend(
        self, yaw_deg: float, weights: Literal["area", "angle"], blur: float, reach: float
    ) -> tuple[Ints, Floats]:
        """The (M,) pixels in which a surface is seen, and the (M, 3) interpolated normals there."""
        pixels, shift, seen = self._seen(yaw_deg, blur)
        values, corners = self._by_area if weights == "area" else self._by_angle
        if not reach:
            return pixels, blend(values, corners[seen.faces], seen.barycentric)
        # Lines through the pixels' centres are known; those beside an outline are not.
        bent = shift.any(axis=1)
        place = np.full(_SIDE * _SIDE, -1)
        place[pixels[~bent]] = np.flatnonzero(~bent)
        lines = self._lines(yaw_deg)
        rays = place[lines.ray]
        met = lines.of(rays >= 0, rays[rays >= 0])
        more = self._cast(yaw_deg, pixels[bent], shift[bent], first=False)
        met = met.and_of(more.of(np.arange(len(more.ray)), np.flatnonzero(bent)[more.ray]))
        blended = blend(values, corners[met.faces], met.barycentric)
        behind = met.depth - seen.depth[met.ray]
        share = np.exp(-np.maximum(behind, 0.0) / reach)
        total = np.bincount(met.ray, share, len(pixels))
        sums = [np.bincount(met.ray, share * axis, len(pixels)) for axis in blended.T]
        known = total > 0
        return pixels[known], np.stack(sums, axis=1)[known] / total[known, None]

    def _look(self, yaw_deg: float, blur: float) -> tuple[Ints, Floats, _Met]:
        """The (N,) pixels in which something is seen, where in each, and what.

        Beside an outline, a face that comes near enough to the pixel's centre counts.
        """
        known = self._lines(yaw_deg).nearest()
        if not blur:
            return known.ray, np.zeros((len(known.ray), 2)), known
        # What is seen in each pixel, by its number: the nearest surface at first.
        which = np.full(_SIDE * _SIDE, -1)
        which[known.ray] = np.arange(len(known.ray))
        image = np.append(known.depth, np.inf)[which]
        beside = np.flatnonzero(_beside_steps(image.reshape(_SIDE, _SIDE)))
        angles = np.arange(8) * np.pi / 4
        around = blur * np.stack([np.sin(angles), np.cos(angles)], axis=1)
        moved = np.tile(around, (len(beside), 1))
        found = self._cast(yaw_deg, np.repeat(beside, 8), moved, first=True)
        at, turns = np.divmod(found.ray, 8)
        for turn in range(8):
            mine = np.flatnonzero(turns == turn)
            nearer = mine[found.depth[mine] < image[beside[at[mine]]] - _STEP]
            chosen = beside[at[nearer]]
            image[chosen], which[chosen] = found.depth[nearer], len(known.ray) + nearer
        pixels = np.flatnonzero(which >= 0)
        shift = np.concatenate([np.zeros((len(known.ray), 2)), moved[found.ray]])
        return pixels, shift[which[pixels]], known.and_of(found).of(which[pixels])

    def _met_by_lines(self, yaw_deg: float) -> _Met:
        """All that the lines through the pixels' centres meet; a ray is a pixel's number.

        Opposite sides look along the same lines.
        """
        if yaw_deg >= _HALF_TURN_DEG:
            met = self._lines(yaw_deg - _HALF_TURN_DEG)
            row, column = np.divmod(met.ray, _SIDE)
            mirrored = row * _SIDE + (_SIDE - 1 - column)
            return _Met(mirrored, 2 * _FAR - met.depth, met.faces, met.barycentric)
        pixels = self._frame(yaw_deg)
        met = self._cast(yaw_deg, pixels, np.zeros((len(pixels), 2)), first=False)
        return _Met(pixels[met.ray], met.depth, met.faces, met.barycentric)

    def _frame(self, yaw_deg: float) -> Ints:
        """(N,) pixels around the surface, row by row."""
        corners = np.array(np.meshgrid(*self._surface.bounds.T)).reshape(3, -1).T
        across = (corners - self._middle) @ _axes(yaw_deg)[:2].T * self._window.per_metre
        across *= [1.0, -1.0]
        low, high = (
            np.clip(np.floor((end + 1.0) * _SIDE / 2) + step, 0, _SIDE).astype(int)
            for end, step in ((across.min(axis=0), -1), (across.max(axis=0), 2))
        )
        rows, columns = np.arange(low[1], high[1]), np.arange(low[0], high[0])
        return (rows[:, None] * _SIDE + columns).ravel()

    @property
    def _middle(self) -> Floats:
        return np.array([0.0, self._window.middle_m, 0.0])

    def _cast(self, yaw_deg: float, pixels: Ints, shift: Floats, *, first: bool) -> _Met:
        """What the rays of (N,) pixels meet, all or first, each moved by a (N, 2) part of one."""
        row, column = (np.divmod(pixels, _SIDE) + (0.5 + shift).T) * 2 / _SIDE - 1.0
        there = np.stack([column, -row, np.full(len(row), _FAR)], axis=1)
        origins = self._middle + (there / self._window.per_metre) @ _axes(yaw_deg)
        ray, distance, faces, barycentric = self._surface.crossings(
            origins, -_axes(yaw_deg)[2], first=first
        )
        return _Met(ray, distance * self._window.per_metre, faces, barycentric)

    @property
    def _by_area(self) -> tuple[Floats, Ints]:
        return self._surface.corner_normals

    @cached_property
    def _by_angle(self) -> tuple[Floats, Ints]:
        """(K, 3) smooth unit normals in which faces weigh by angle, and each corner's number."""
        mesh, group = self._surface.mesh, self._surface.corners
        first, second, third = (mesh.vertices[corner] for corner in mesh.faces.T)
        ahead = second - first, third - second, first - third
        sizes = [np.sqrt(np.einsum("ij,ij->i", each, each)) for each in ahead]
        angles = []
        for k in range(3):
            size = sizes[k] * sizes[k - 1]
            along = np.einsum("ij,ij->i", ahead[k], ahead[k - 1]) / np.where(size > 0, size, 1.0)
            angles.append(np.arccos(np.clip(-along, -1.0, 1.0)))
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


def _unit(vectors: Floats) -> Floats:
    lengths = np.sqrt(np.einsum("...k,...k->...", vectors, vectors))[..., None]
    return vectors / np.where(lengths > 0, lengths, 1.0)
