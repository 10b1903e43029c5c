"""The scan's normals in the views that a method is given, for methods with that privilege."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.core.camera import Camera
from harness.core.errors import MethodError
from harness.core.mesh import Mesh
from harness.geometry.raycast import Raycaster, Side


class OracleNormals:
    """Renders normals of the scan on request, and of no view but the method's own.

    Args:
        truth: The scan, world metres.
        cameras: The cameras of the method's views; crops and other sizes of them count as the
            same views.
    """

    def __init__(self, truth: Mesh, cameras: Sequence[Camera]) -> None:
        self._truth = truth
        self._cameras = tuple(cameras)
        self._caster: Raycaster | None = None

    def __call__(self, camera: Camera, side: Side = "near") -> NDArray[np.float64]:
        """(H, W, 3) unit normals, x right, y up, z towards the viewer; 0 beside the scan.

        ``far`` is the last surface along the same rays.

        Raises:
            MethodError: the camera does not stand where one of the method's views does.
        """
        if not any(
            np.allclose(camera.world_to_camera, own.world_to_camera, rtol=0.0, atol=1e-9)
            for own in self._cameras
        ):
            raise MethodError(
                "the normals of the scan were asked for in a view that the method is not given",
                expected=f"one of its {len(self._cameras)} cameras, or a crop of it",
                got=f"a camera at {np.round(camera.position, 3).tolist()}",
            )
        if self._caster is None:
            self._caster = Raycaster(self._truth.geometry())
        return self._caster.normals(camera, side)
