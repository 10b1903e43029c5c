"""Clothed normals for the body fit's normal term, from the network that also makes the sheets.

The network wants to know the body, and the body is what is sought. Source: MExECON, equation of the
normal loss, whose normals are those of ECON's front network in every view.
"""

import numpy as np

from harness.core.arrays import Floats, Ints32
from harness.core.artifacts import Capture
from harness.core.camera import Camera
from harness.core.mesh import Mesh
from harness.geometry.images import unit_normals
from harness.geometry.raycast import Raycaster
from methods.body.photos.views import Views
from methods.normals import NormalChoice, view_maps, working_view

#: Side of the square that the network looks at, pixels.
_RESOLUTION = 512
#: A blend of normals shorter than this is of the outline's outer side, or of a fold's two.
_SHORTEST = 0.5


class EstimatedNormals:
    """The clothed normals of some views, estimated anew for each body that is handed in.

    Args:
        capture: The photos.
        views: The fit's own pictures of them.
        faces: (F, 3) the body's.
        choice: Which estimator runs.

    Raises:
        MissingPart, DataError: as ``NormalChoice.estimator``.
    """

    def __init__(self, capture: Capture, views: Views, faces: Ints32, choice: NormalChoice) -> None:
        self._faces = faces
        self._cameras = [view.camera for view in views.views]
        self._windows = [
            working_view(capture, view.index, _RESOLUTION, choice.side_px) for view in views.views
        ]
        self._estimators = [choice.estimator(window.camera, {}) for window in self._windows]

    def __call__(self, vertices: Floats) -> list[Floats]:
        """Per view (H, W, 3) unit normals in the map frame, for a body (V, 3), world metres.

        Raises:
            MethodError: the body is not where a view shows the subject.
        """
        caster = Raycaster(Mesh(vertices, self._faces, source="fitted body"))
        return [
            _seen_by(camera, window.camera, view_maps(window, caster, estimator).front)
            for camera, window, estimator in zip(
                self._cameras, self._windows, self._estimators, strict=True
            )
        ]


def _seen_by(camera: Camera, window: Camera, normals: Floats) -> Floats:
    """(H, W, 3) unit normals of a window on the pixels of a camera in the same place."""
    from scipy.ndimage import map_coordinates

    pixels = camera.pixel_centres().reshape(-1, 2)
    seen_points = camera.ray_origins(pixels) + camera.ray_directions(pixels)
    columns, rows = window.project(seen_points)[0].T - 0.5
    blended = np.stack(
        [map_coordinates(normals[..., axis], [rows, columns], order=1) for axis in range(3)],
        axis=-1,
    )
    length = np.linalg.norm(blended, axis=1, keepdims=True)
    seen = unit_normals(np.where(length > _SHORTEST, blended, 0.0))
    return seen.reshape(camera.height, camera.width, 3)
