"""Whether a mesh stands in the world's frame: unit, place, axes, mirror, winding, holes.

Axes are found by comparing the mesh with the scan under all 48 ways to exchange and reverse them.
The mesh's own one has to be the nearest, or nearly: a subject that looks alike from two sides
decides nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.mesh import Mesh
from harness.geometry.coinciding import merged_positions
from harness.geometry.topology import open_edges
from harness.pipeline.conformance.verdict import Answer, Check

_POINTS = 1500
#: A reconstruction is somewhat larger or smaller than the subject, and not by a unit.
_SIZES = (0.7, 1.4)
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "inches": 39.37, "kilometres": 0.001}
_FAR_M = 0.25
#: How much nearer another frame has to be before it is taken for the method's.
_NEARER = 1.2
_NEARER_M = 0.002
#: Vertices are in one place if these digits of metres are the same.
_DIGITS = 7


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """A way from a method's axes to the world's.

    Attributes:
        up: The axis of the mesh that is the subject's up.
        yaw_deg: How far it is turned about that.
        mirrored: Whether left and right are exchanged.
        matrix: (3, 3) to the world.
    """

    up: str
    yaw_deg: int
    mirrored: bool
    matrix: Floats

    @property
    def is_ours(self) -> bool:
        return self.up == "+y" and not self.yaw_deg and not self.mirrored


#: (3, 3) turns that make each axis the vertical one; +z as Blender and nerfstudio have it.
_UPS = {
    "+y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    "+z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "+x": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    "-x": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
}


def _frames() -> Iterator[_Frame]:
    for (up, turn), yaw, mirrored in itertools.product(
        _UPS.items(), (0, 90, 180, 270), (False, True)
    ):
        cosine, sine = round(np.cos(np.radians(yaw))), round(np.sin(np.radians(yaw)))
        about = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        mirror = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
        matrix = np.asarray(mirror @ about @ np.array(turn), dtype=np.float64)
        yield _Frame(up, yaw, mirrored, matrix)


def frame_checks(mesh: Mesh, truth: Mesh, *, is_scan: bool) -> list[Check]:
    """The questions about the mesh alone.

    Args:
        mesh: What the method made.
        truth: The subject's scan, world metres.
        is_scan: Whether the method hands the scan out, whose holes are not its own.
    """
    ratio = _diagonal(mesh) / _diagonal(truth)
    in_metres = _SIZES[0] <= ratio <= _SIZES[1]
    # Other points on each: two copies of one surface must not be nearer than two of its sides.
    ours, true = _sampled(mesh, 0), _sampled(truth, 1)
    middle = _middle(mesh)
    away_m = float(np.linalg.norm(middle - _middle(truth)))
    scaled = (ours - middle) / (1.0 if in_metres else ratio)
    found, nearest_mm, own_mm = _nearest(scaled, true - _middle(truth))
    near = f"{own_mm:.1f} mm from the scan as it is"
    best = near if found.is_ours else f"{near}, {nearest_mm:.1f} mm when that is changed"
    holes = _holes(mesh)
    volume = mesh.signed_volume
    return [
        Check("metres", _answer(in_metres), _size_text(ratio, in_metres)),
        _place(away_m, in_metres),
        Check("up", _answer(found.up == "+y"), f"{found.up} is; {best}"),
        Check("facing", _answer(not found.yaw_deg), f"turned by {found.yaw_deg} degrees; {best}"),
        Check("handedness", _answer(not found.mirrored),
              f"{'mirrored' if found.mirrored else 'not mirrored'}; {best}"),
        Check("winding", _answer(volume > 0), f"a volume of {volume:.4f} cubic units"),
        Check("watertight", "not asked", f"the scan's own surface, {holes} open edges")
        if is_scan
        else Check("watertight", _answer(not holes), f"{holes} open edges"),
    ]  # fmt: skip


def _answer(holds: bool) -> Answer:
    return "yes" if holds else "no"


def _place(away_m: float, in_metres: bool) -> Check:
    if not in_metres:
        return Check("place", "not asked", "not in metres")
    return Check("place", _answer(away_m <= _FAR_M), f"{away_m:.3f} m from the scan's middle")


def _size_text(ratio: float, in_metres: bool) -> str:
    text = f"{ratio:.3g} times the size of the scan"
    unit = min(_UNITS, key=lambda name: abs(np.log(ratio / _UNITS[name])))
    if in_metres or not _SIZES[0] <= ratio / _UNITS[unit] <= _SIZES[1]:
        return text
    return f"{text}, as if in {unit}"


def _nearest(ours: Floats, truth: Floats) -> tuple[_Frame, float, float]:
    """The frame in which the points are nearest, its distance and that of the world's, mm."""
    from scipy.spatial import KDTree

    tree = KDTree(truth)
    found: list[tuple[float, _Frame]] = []
    for frame in _frames():
        turned = ours @ frame.matrix.T
        there = tree.query(turned)[0].mean()
        back = KDTree(turned).query(truth)[0].mean()
        found.append((float(there + back) / 2, frame))
    nearest_m, nearest = min(found, key=lambda each: each[0])
    own_m, own = next(each for each in found if each[1].is_ours)
    is_own = own_m <= _NEARER * nearest_m + _NEARER_M
    return (own if is_own else nearest), 1000 * nearest_m, 1000 * own_m


def _sampled(mesh: Mesh, seed: int) -> Floats:
    """(P, 3) points on the surface, evenly by area, always the same ones."""
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    dice = np.random.default_rng(seed)
    chosen = dice.choice(len(area), size=_POINTS, p=area / area.sum())
    u, v = np.sqrt(dice.random(_POINTS)), dice.random(_POINTS)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    return np.einsum("pc,pcx->px", weights, corners[chosen])


def _middle(mesh: Mesh) -> Floats:
    return mesh.bounds.mean(axis=0)


def _diagonal(mesh: Mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))


def _holes(mesh: Mesh) -> int:
    """Edges that do not join two faces, where vertices in one place count as one."""
    merged = merged_positions(np.round(mesh.vertices, _DIGITS))
    _, first = np.unique(merged, return_index=True)
    a, b, c = corners = merged[mesh.faces].T
    faces = corners.T[(a != b) & (b != c) & (c != a)]
    return open_edges(Mesh(mesh.vertices[first], faces))
