"""How large a scan is without the specks beside it, and what sticks out of it."""

from dataclasses import dataclass

import numpy as np

from harness.core.arrays import Floats
from harness.core.mesh import Mesh
from harness.geometry.coinciding import edges_of, pieces_of
from harness.geometry.surface import merged_positions

#: A piece with less than this share of the area is a speck; if these are more together than this
#: share, the surface consists of such pieces, and none is one.
_SPECK, _MOST_SPECKS = 1e-3, 0.05
#: Specks that change a side by less than this share of it do not matter.
_SAME = 5e-3
#: So few vertices are a spike that are beyond all others by this share of the longest side, and by
#: this many times the mean edge.
_FEW, _SPIKE, _EDGES = 3, 0.02, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Stature:
    """What a scan measures.

    Attributes:
        extent: (3,) sides of its bounding box in its units, without specks.
        told: What is out of the ordinary, in words.
    """

    extent: Floats
    told: tuple[str, ...]


def stature(mesh: Mesh) -> Stature:
    """The size of a scan; loose specks beyond it do not count, and spikes are told."""
    group = merged_positions(mesh.vertices)
    faces = group[mesh.faces]
    pieces = pieces_of(faces, int(group.max()) + 1)
    areas = np.bincount(pieces.of_face, mesh.face_areas(), len(pieces.face_counts))
    specks = areas < _SPECK * areas.sum()
    extent, told = mesh.extent, list[str]()
    is_body = ~specks[pieces.of_face]
    if specks.any() and areas[specks].sum() < _MOST_SPECKS * areas.sum():
        body = mesh.submesh(is_body)
        if (extent - body.extent > _SAME * extent).any():
            told.append(
                f"loose specks lie beyond the person, which measures {_sides(body.extent)} without "
                f"them, {_sides(extent)} with them; they do not count for its height"
            )
            mesh, extent = body, body.extent
    return Stature(extent, (*told, *_spikes(mesh)))


def _spikes(mesh: Mesh) -> list[str]:
    places = np.unique(mesh.vertices[np.unique(mesh.faces)], axis=0)
    if len(places) <= 2 * _FEW:
        return []
    ends = edges_of(mesh.faces).ends
    edge = float(np.linalg.norm(np.diff(mesh.vertices[ends], axis=1), axis=2).mean())
    least = max(_SPIKE * float(mesh.extent.max()), _EDGES * edge)
    found: list[str] = []
    for axis, letter in enumerate("xyz"):
        ordered = np.sort(places[:, axis])
        gaps = {"-": ordered[1 : _FEW + 1] - ordered[:_FEW], "+": np.diff(ordered[-_FEW - 1 :])}
        found += [
            f"a spike sticks out by {gap.max():.2g} towards {sign}{letter} and counts: is it right?"
            for sign, gap in gaps.items()
            if gap.max() > least
        ]
    return found


def _sides(extent: Floats) -> str:
    return " x ".join(f"{side:.4g}" for side in extent)
