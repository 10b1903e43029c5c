"""Coarse surfaces made smooth: limbs without facets, shoes without edges."""

from __future__ import annotations

import numpy as np

from clothed_avatars.mesh.quads import Floats, Ints, neighbour_means, on_border, subdivision

_SPACING_M = 0.006
_MOST_LEVELS = 4
_EVENINGS = 2


def smooth_quads(vertices: Floats, quads: Ints) -> tuple[Floats, Ints]:
    """A quad surface twice as fine and with hardly a facet, within about a millimetre of it."""
    matrix, fine = subdivision(len(vertices), quads)
    points: Floats = matrix @ vertices
    means, held = neighbour_means(len(points), fine), on_border(len(points), fine)[:, None]
    for _ in range(_EVENINGS):
        points = np.where(held, points, 0.5 * (points + means @ points))
    return points, fine


def rounded(vertices: Floats, triangles: Ints, radius_m: float) -> tuple[Floats, Ints]:
    """A closed triangle surface whose edges are rounded by about ``radius_m``; flat sides stay.

    A surface less than six radii thick is rounded less.
    """
    import open3d as o3d

    radius_m = min(radius_m, float(np.ptp(vertices, axis=0).min()) / 6)
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(triangles.astype(np.int32))
    )
    mesh.remove_unreferenced_vertices()
    for _ in range(_MOST_LEVELS):
        points, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
        longest = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)
        spacing = float(np.median(longest))
        if spacing < _SPACING_M:
            break
        mesh = mesh.subdivide_midpoint(1)
    points = np.asarray(mesh.vertices).astype(float)
    faces = np.asarray(mesh.triangles).astype(np.int64)
    spacing = float(np.median(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1)))
    means = neighbour_means(len(points), faces)
    # Each step with half weight spreads by the root of half the spacing's square.
    for _ in range(max(1, round(2 * (radius_m / max(spacing, 1e-4)) ** 2))):
        points = 0.5 * (points + means @ points)
    return points, faces
