"""A closed surface held to the silhouettes: what bulges beyond a mask is pressed back to its rim.

Poisson reconstruction bulges where no view sees anything, such as under the soles. The masks see
the bulge from the side: a vertex outside one is moved across the line of sight to the outline, view
by view, until it is inside all or nearly so. The faces stay the same, so that the surface stays
closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.core.arrays import Floats, Ints
from harness.core.mesh import Mesh
from harness.geometry.images import sampled
from harness.geometry.outline import Outline

#: Vertices less far outside are left alone; and turns through all views.
_TOLERANCE_PX, _TURNS = 0.5, 8


def held_to(mesh: Mesh, outlines: Sequence[Outline]) -> Mesh:
    """The mesh without what lies outside the silhouettes; vertices inside all stay where they are.

    Args:
        mesh: World metres.
        outlines: Outlines of all views.
    """
    vertices = mesh.vertices.copy()
    for _ in range(_TURNS):
        moved = False
        for outline in outlines:
            outside, motion = _back_inside(vertices, outline)
            vertices[outside] += motion
            moved |= len(outside) > 0
        if not moved:
            break
    return replace(mesh, vertices=vertices)


def _back_inside(points: Floats, outline: Outline) -> tuple[Ints, Floats]:
    """Indices (M,) of the points outside a silhouette, and (M, 3) the way to its outline."""
    camera = outline.camera
    pixels, depth = camera.project(points)
    with np.errstate(invalid="ignore"):  # behind the camera: NaN, so not in the frame
        framed = ((pixels >= 0) & (pixels < camera.size)).all(axis=1)
    index = np.flatnonzero(framed)
    field = outline.distance_px
    distance = sampled(field, pixels[index]).astype(np.float64)
    index, distance = index[distance < -_TOLERANCE_PX], distance[distance < -_TOLERANCE_PX]
    down, across = np.gradient(field)
    at = pixels[index]
    slope = np.column_stack([sampled(across, at), sampled(down, at)]).astype(np.float64)
    slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-6)
    there = at - distance[:, None] * slope
    return index, camera.unproject(there, depth[index]) - points[index]
