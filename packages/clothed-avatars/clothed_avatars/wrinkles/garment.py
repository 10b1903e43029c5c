"""A draped garment with its wrinkles: coarse folds first, finer ones on a finer mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clothed_avatars.clothes.layer import Layer
from clothed_avatars.mesh.nearness import Nearness
from clothed_avatars.mesh.quads import (
    Floats,
    Ints,
    SparseMatrix,
    border_loops,
    neighbour_means,
    on_border,
    subdivision,
    vertex_normals,
)
from clothed_avatars.wrinkles.construction import relief
from clothed_avatars.wrinkles.crossings import crossing_share, uncrossed
from clothed_avatars.wrinkles.relaxation import (
    Held,
    Springs,
    Steps,
    contacts,
    relaxed,
    springs,
)
from clothed_avatars.wrinkles.ridges import ridges
from clothed_avatars.wrinkles.surplus import Sewn, Tailoring, surplus_of_edges
from harness.core.arrays import Mask

_LEVELS = 3
_STEPS = (250, 160, 60)
_GAP_M = 0.003
_UNCHECKED = 2


@dataclass(frozen=True)
class Wrinkled:
    """vertices (V,3) on the posed body; quads (Q,4), pattern (V,3), part (V,) and pin (V,) as in
    ``Piece``; to_hem (V,): distance to the nearest border of the cut, metres; crossing: the share
    of its edges that pass through it.
    """

    vertices: Floats
    quads: Ints
    pattern: Floats
    part: Ints
    pin: Floats
    to_hem: Floats
    crossing: float

    def open_loops(self) -> list[Floats]:
        """The borders (N,3) that hang free: hems and cuffs, not the one that the body holds."""
        return [
            self.vertices[loop] for loop in border_loops(self.quads) if not self.pin[loop].any()
        ]

    def layer(self, name: str) -> Layer:
        """The garment as a layer, its place holding limb and distance to the nearest hem."""
        place = np.column_stack([self.pattern, self.part.astype(float), self.to_hem])
        return Layer(name, self.vertices, self.quads, place)


@dataclass(frozen=True)
class _Level:
    """One fineness: the garment's places, how far it is moved (V,3), its quads and held part."""

    sewn: Sewn
    moved: Floats
    quads: Ints
    pin: Floats


def _evened(points: Floats, means: SparseMatrix, border: Mask) -> Floats:
    """Points (V,3) moved half way to the mean of their neighbours; borders stay."""
    return np.where(border[:, None], points, 0.5 * (points + means @ points))


def _without_checks(points: Floats, quads: Ints) -> Floats:
    """A drape (V,3) without the checkerboard that pressed cloth makes on a coarse mesh.

    What changes sign from vertex to vertex goes; folds of four and more vertices keep 94 % and up.
    """
    means, border = neighbour_means(len(points), quads), on_border(len(points), quads)
    for _ in range(_UNCHECKED):
        bend = points - means @ points
        bend = np.where(border[:, None], 0.0, bend - means @ bend)
        points = points - 0.25 * bend
    return points


def _finer(level: _Level) -> _Level:
    sewn = level.sewn
    matrix, quads = subdivision(len(sewn.draped), level.quads)
    left, right = (matrix @ (sewn.part == value).astype(float) for value in (1, 2))
    net = springs(matrix.shape[0], quads)
    border = on_border(matrix.shape[0], quads)
    draped, cut, carried = (
        _evened(matrix @ points, net.means, border)
        for points in (sewn.draped, sewn.cut, sewn.carried)
    )
    part = np.where(left > 0.5, 1, np.where(right > 0.5, 2, 0))
    fine = Sewn(draped, cut, carried, matrix @ sewn.pattern, part)
    return _Level(fine, matrix @ level.moved, quads, matrix @ level.pin)


def _settled(
    tailoring: Tailoring, level: _Level, number: int, obstacles: Sequence[Nearness]
) -> _Level:
    sewn, weave = level.sewn, tailoring.weave
    net = springs(len(sewn.draped), level.quads)
    surplus = surplus_of_edges(tailoring, sewn, net.ends)
    lengths = _lengths(sewn.draped, net)
    heights = ridges(
        net,
        weave.laid[number] * surplus,
        lengths,
        weave.waves_m[number],
        tailoring.seed + 10 + number,
    )
    normals = vertex_normals(sewn.draped, level.quads)
    start = sewn.draped + level.moved + heights[:, None] * normals
    held = Held(level.pin > 0.5, contacts(sewn.draped, obstacles, _GAP_M))
    steps = Steps(_STEPS[number], weave.bending[number])
    now = relaxed(sewn.draped, start, lengths * (1 + surplus), net, steps, held)
    moved = uncrossed(sewn.draped, now - sewn.draped, level.quads, net.means)
    return _Level(sewn, moved, level.quads, level.pin)


def _lengths(points: Floats, net: Springs) -> Floats:
    return np.linalg.norm(points[net.ends[:, 0]] - points[net.ends[:, 1]], axis=1)


def wrinkled(
    tailoring: Tailoring, draped: Floats, carried: Floats, obstacles: Sequence[Nearness]
) -> Wrinkled:
    """The garment, four times as fine, with its wrinkles.

    draped (V,3): the piece's vertices at rest. carried (V,3): its cut moved with the bones into the
    pose. obstacles: body and garments below, which it stays 3 mm off.
    """
    piece = tailoring.piece
    smooth = _without_checks(draped, piece.quads)
    sewn = Sewn(smooth, piece.vertices, carried, piece.pattern, piece.part)
    level = _Level(sewn, np.zeros_like(draped), piece.quads, piece.pin)
    for number in range(_LEVELS):
        if number:
            level = _finer(level)
        level = _settled(tailoring, level, number, obstacles)
    return _sewn(tailoring, level)


def _sewn(tailoring: Tailoring, level: _Level) -> Wrinkled:
    """The garment with hems, seams and what is sewn on, at its last level."""
    from scipy.spatial import KDTree

    found, quads = level.sewn, level.quads
    vertices = found.draped + level.moved
    to_hem, _ = KDTree(found.pattern[on_border(len(vertices), quads)]).query(found.pattern)
    if tailoring.construction is not None:
        height = relief(
            tailoring.body,
            tailoring.construction,
            found.pattern,
            found.part,
            to_hem,
            tailoring.is_top,
        )
        vertices = vertices + height[:, None] * vertex_normals(vertices, quads)
    crossing = crossing_share(vertices, quads)
    return Wrinkled(vertices, quads, found.pattern, found.part, level.pin, to_hem, crossing)
