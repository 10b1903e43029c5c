"""Clothed normals for the body fit's normal term, from the network that also makes the sheets.

The network wants to know the body, and the body is what is sought: so the normals are estimated
once, with the body that the fit starts from, and stay. Source: MExECON, equation of the normal
loss, whose normals are those of ECON's front network in every view.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.images import unit_normals
from harness.geometry.sides import SidedRaycaster
from methods.body.views import Views
from methods.normals import NormalChoice, view_maps, working_view

__all__ = ["with_estimated_normals"]

Floats = NDArray[np.float64]

#: Side of the square that the network looks at, pixels.
_RESOLUTION = 512
#: A blend of normals shorter than this is of the outline's outer side, or of a fold's two.
_SHORTEST = 0.5


def with_estimated_normals(
    capture: Capture, views: Views, body: Mesh, choice: NormalChoice
) -> Views:
    """The same views, each with the clothed normals that it shows.

    Args:
        capture: The photos.
        views: The fit's own pictures of them.
        body: What the estimator is told of the person, world metres.
        choice: Of the estimator.

    Raises:
        MethodError: the body is not where a view shows the subject.
        MissingPart, DataError: as ``NormalChoice.estimator``.
    """
    caster = SidedRaycaster(body)
    seen = []
    for view in views.views:
        window = working_view(capture, view.index, _RESOLUTION)
        maps = view_maps(window, caster, choice.estimator(window.camera, {}))
        normals = _seen_by(view.camera, window.camera, maps.front)
        seen.append(replace(view, normals_camera=normals))
    return replace(views, views=tuple(seen))


def _seen_by(camera: Camera, window: Camera, normals: Floats) -> Floats:
    """(H, W, 3) unit normals of a window on the pixels of a camera in the same place."""
    from scipy.ndimage import map_coordinates

    rays = camera.ray_directions(camera.pixel_centres().reshape(-1, 2))
    columns, rows = window.project(camera.position + rays)[0].T - 0.5
    blended = np.stack(
        [map_coordinates(normals[..., axis], [rows, columns], order=1) for axis in range(3)],
        axis=-1,
    )
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    seen = unit_normals(np.where(length > _SHORTEST, blended, 0.0))
    return seen.reshape(camera.height, camera.width, 3)
