"""Texture coordinates for a closed surface: flat charts without folds, packed into one square.

A chart is a connected set of faces seen along one of six directions and laid out by parallel
projection, so no face can flip; where a chart would cover itself, the hidden faces become charts
of their own. Charts are packed by their outlines (after the skyline packing of B. Levy et al.,
"Least squares conformal maps", 2002).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clothed_avatars.mesh.faces import connected, neighbours
from clothed_avatars.mesh.quads import Floats, Ints
from harness.core.errors import DataError

_DIRECTIONS: Floats = np.concatenate([np.eye(3), -np.eye(3)])
_SMOOTHING_ROUNDS = 12
_NEIGHBOUR_WEIGHT = 0.35
_SMALL_CHART = 60
_LEAST_COSINE = 0.12
_PADDING = 2
_FILL = 0.52
_SHRINK = 0.965
_CUTS = 8
_AT_ONCE = 8192
"""Faces that are rasterized at once: what they need fits into the processor's cache."""


@dataclass(frozen=True)
class Texels:
    """Texels under faces: face (N,), column and row (N,) (row 0 at v = 0), weights (N,3)."""

    face: Ints
    column: Ints
    row: Ints
    weights: Floats


@dataclass(frozen=True)
class Atlas:
    """uv (T,2) in [0,1], origin bottom left; uv_faces (F,3); chart (F,); all faces' texels."""

    uv: Floats
    uv_faces: Ints
    chart: Ints
    texels: Texels


def _view_labels(normals: Floats, across: Ints) -> Ints:
    """The direction (F,) from which each face is laid out: it faces there, as its neighbours do."""
    facing = normals @ _DIRECTIONS.T
    label = facing.argmax(1)
    allowed = np.where(facing > _LEAST_COSINE, 0.0, -np.inf)
    open_to = facing + allowed
    one, two, three = across.T
    unit = np.eye(len(_DIRECTIONS), dtype=np.int8)
    weight = _NEIGHBOUR_WEIGHT * np.arange(4.0)  # of none to three neighbours
    for _ in range(_SMOOTHING_ROUNDS):
        voice = unit[label]
        votes = voice[one] + voice[two] + voice[three]
        label = (open_to + weight[votes]).argmax(1)
    for _ in range(_SMOOTHING_ROUNDS):
        chart = connected(label, across)
        small = np.bincount(chart)[chart] < _SMALL_CHART
        if not small.any():
            break
        voice = unit[label] * ~small[:, None]
        votes = voice[one] + voice[two] + voice[three]
        score = np.where(votes > 0, 1.0, -5.0) + facing + allowed
        label = np.where(small & (votes.sum(1) > 0), score.argmax(1), label)
    return label


def _flatten(points: Floats, direction: Ints) -> Floats:
    """(N,2) what a viewer in that direction sees, not mirrored."""
    across = np.array([[0, 0, -1], [1, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 0, 0]], float)
    up = np.array([[0, 1, 0], [0, 0, -1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0]], float)
    return np.stack(
        [
            np.einsum("nd,nd->n", points, across[direction]),
            np.einsum("nd,nd->n", points, up[direction]),
        ],
        axis=1,
    )


def _box(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corner (F,2) of the box round each face (F,3,2).

    Corner by corner: numpy is ten times slower along an axis of three.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _outline(boxes: Ints, width: int) -> tuple[Ints, Ints]:
    """Lowest and highest texel (width,) in each column of a chart of face boxes (F,2,2).

    boxes: low and high corner (column, row) of each face; a face counts in all columns it spans.
    """
    low_corner, high_corner = boxes[:, 0], boxes[:, 1]
    first = np.maximum(low_corner[:, 0] - _PADDING, 0)
    span = np.minimum(high_corner[:, 0] + _PADDING, width - 1) - first + 1
    column = np.repeat(first - (np.cumsum(span) - span), span) + np.arange(int(span.sum()))
    low = np.full(width, 1 << 30)
    high = np.full(width, -(1 << 30))
    np.minimum.at(low, column, np.repeat(low_corner[:, 1], span))
    np.maximum.at(high, column, np.repeat(high_corner[:, 1], span))
    return low, high


def _place(sky: Ints, low: Ints) -> tuple[int, int]:
    """Column and base row where an outline comes to lie lowest on the skyline."""
    windows = np.lib.stride_tricks.sliding_window_view(sky, len(low))
    base = (windows - low).max(1)
    column = int(base.argmin())
    return column, int(base[column])


def _pack(points: Floats, chart: Ints, size: int, texel: float) -> Floats | None:
    """(K,2) shift in texels of each chart, or None if they do not fit in ``size`` texels.

    points: (F,3,2) flattened face corners in metres; texel: metres.
    """
    lows, highs = _box(np.floor(points / texel).astype(np.int64))
    count = int(chart.max()) + 1
    order = np.argsort(chart, kind="stable")
    starts = np.searchsorted(chart[order], np.arange(count + 1))
    origin = np.stack([np.full(count, 1 << 30)] * 2, 1)
    np.minimum.at(origin, chart, lows)
    top = np.full((count, 2), -(1 << 30))
    np.maximum.at(top, chart, highs)
    sky = np.zeros(size, np.int64)
    shift = np.zeros((count, 2))
    boxes = np.stack([lows, highs], axis=1) - origin[chart][:, None]
    boxes[..., 0] += _PADDING
    for k in np.lexsort((np.arange(count), -(top - origin)[:, 1])):
        own = boxes[order[starts[k] : starts[k + 1]]]
        width = int(own[..., 0].max()) + _PADDING + 1
        if width > size:
            return None
        low, high = _outline(own, width)
        column, base = _place(sky, low - _PADDING)
        sky[column : column + width] = base + high + _PADDING + 1
        if sky.max() > size:
            return None
        shift[k] = (column + _PADDING, base)
    return shift - origin


def _corner_weights(corners: Floats) -> tuple[Floats, Floats]:
    """Coefficients (F,3) of the weights of each face's second and third corner: u x + v y + w."""
    a = corners[:, 0]
    (bx, by), (cx, cy) = (corners[:, 1] - a).T, (corners[:, 2] - a).T
    area = bx * cy - by * cx
    area = np.where(area > 0, area, np.nan)  # no texel lies in a face without area
    second = np.stack([cy, -cx, cx * a[:, 1] - cy * a[:, 0]], axis=1) / area[:, None]
    third = np.stack([-by, bx, by * a[:, 0] - bx * a[:, 1]], axis=1) / area[:, None]
    return second, third


def rasterize(corners: Floats, size: int) -> Texels:
    """The texels whose centres lie in counter-clockwise faces (F,3,2), given in texels."""
    starts = range(0, max(len(corners), 1), _AT_ONCE)
    parts = [_rasterized(corners[start : start + _AT_ONCE], start, size) for start in starts]
    return Texels(
        np.concatenate([part.face for part in parts]),
        np.concatenate([part.column for part in parts]),
        np.concatenate([part.row for part in parts]),
        np.concatenate([part.weights for part in parts]),
    )


def _rasterized(corners: Floats, first: int, size: int) -> Texels:
    """The texels of some faces, of which the first has the number ``first``."""
    lows, highs = _box(corners)
    low = np.clip(np.floor(lows - 0.5), 0, size - 1).astype(np.int64)
    high = np.clip(np.ceil(highs - 0.5), 0, size - 1).astype(np.int64)
    extent = high - low + 1
    number = extent[:, 0] * extent[:, 1]
    face = np.repeat(np.arange(len(corners)), number)
    local = np.arange(len(face)) - np.repeat(np.cumsum(number) - number, number)
    width = np.repeat(extent[:, 0].astype(np.int32), number)
    down, along = np.divmod(local.astype(np.int32), width)
    column = np.repeat(low[:, 0], number) + along
    row = np.repeat(low[:, 1], number) + down
    x, y = column + 0.5, row + 0.5
    second, third = (
        np.repeat(slope[:, 0], number) * x
        + np.repeat(slope[:, 1], number) * y
        + np.repeat(slope[:, 2], number)
        for slope in _corner_weights(corners)
    )
    inside = (second >= 0) & (third >= 0) & (second + third <= 1)
    second, third = second[inside], third[inside]
    weights = np.stack([1 - second - third, second, third], axis=1)
    return Texels(first + face[inside], column[inside], row[inside], weights)


def _covered(texels: Texels, depth: Floats, size: int) -> Ints:
    """Faces that lie, somewhere, under another face of their own chart."""
    inner = texels.weights.min(1) > 1e-6  # a texel on a shared edge is no overlap
    key = texels.row[inner] * size + texels.column[inner]
    face = texels.face[inner]
    order = np.lexsort((depth[face], key))
    key, face = key[order], face[order]
    return np.unique(face[:-1][key[:-1] == key[1:]])


def unwrap(vertices: Floats, faces: Ints, size: int) -> Atlas:
    """Texture coordinates of a closed surface, vertices (V,3) m, in a texture of ``size`` texels.

    Raises:
        DataError: the surface is not closed, or charts still overlap after several cuts.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    across = neighbours(faces)
    direction = _view_labels(normals, across)
    flat = _flatten(corners.reshape(-1, 3), np.repeat(direction, 3)).reshape(-1, 3, 2)
    depth = np.einsum("fd,fd->f", corners.mean(1), _DIRECTIONS[direction])
    layer = np.zeros(len(faces), np.int64)
    covered = np.zeros(0, np.int64)
    texel = np.sqrt(_signed_area(flat).clip(0).sum() / (_FILL * size**2))
    for cut in range(_CUTS):
        chart = connected(direction + len(_DIRECTIONS) * layer, across)
        while (shift := _pack(flat, chart, size, texel)) is None:
            texel /= _SHRINK
        placed = flat / texel + shift[chart][:, None]
        texels = rasterize(placed, size)
        covered = _covered(texels, depth, size)
        if len(covered) == 0:
            return _weld(placed / size, faces, chart, texels)
        if cut < _CUTS // 2:
            layer[covered] += 1
        else:  # faces that go on covering each other become charts of one face, which cannot
            layer[covered] = layer.max() + 1 + np.arange(len(covered))
    raise DataError(
        f"charts still cover themselves after {_CUTS} cuts",
        expected="no overlap",
        got=f"{len(covered)} faces",
    )


def _signed_area(flat: Floats) -> Floats:
    edge, other = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    return 0.5 * (edge[:, 0] * other[:, 1] - edge[:, 1] * other[:, 0])


def _weld(placed: Floats, faces: Ints, chart: Ints, texels: Texels) -> Atlas:
    """One texture corner per vertex and chart."""
    key = chart[:, None] * (int(faces.max()) + 1) + faces
    _, first, uv_faces = np.unique(key, return_index=True, return_inverse=True)
    return Atlas(placed.reshape(-1, 2)[first], uv_faces.reshape(-1, 3), chart, texels)
