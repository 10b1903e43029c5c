"""A whole method in one file: a stack of ellipses from a front and a side silhouette."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness import (
    Camera,
    Capture,
    Context,
    Mesh,
    MethodError,
    MethodInfo,
    Privilege,
    Reconstruction,
    load_mask,
)

# Views count from the front: of eight, view 2 shows the subject's left side.
_FRONT, _SIDE = 0, 2
_SLICES = 100
_CORNERS = 48


class EllipseStack:
    """At each height, the ellipse that is as wide as the front and as deep as the side photo."""

    # What tables and records say about the method. Privileges name what is given beyond pixels.
    info = MethodInfo(
        name="ellipse-stack",
        title="Ellipse stack, 2 views",
        views=(_FRONT, _SIDE),
        privileges=(Privilege.KNOWN_CAMERAS, Privilege.EXACT_MASKS),
    )

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:
        """The subject's surface in metres, world frame.

        Raises:
            MethodError: a photo shows no subject; the reason goes into the record.
        """
        with context.stage("silhouettes"):  # stages are timed, and their memory is measured
            widths = _extent(capture, _FRONT, axis=0)
            depths = _extent(capture, _SIDE, axis=2)
        with context.stage("stack"):
            lowest = max(widths[0, 0], depths[0, 0])
            highest = min(widths[-1, 0], depths[-1, 0])
            heights = np.linspace(lowest, highest, _SLICES)
            x0, x1 = (np.interp(heights, widths[:, 0], widths[:, end]) for end in (1, 2))
            z0, z1 = (np.interp(heights, depths[:, 0], depths[:, end]) for end in (1, 2))
            mesh = _stack(heights, (x0 + x1) / 2, (x1 - x0) / 2, (z0 + z1) / 2, (z1 - z0) / 2)
        return Reconstruction(mesh=mesh)


def _extent(capture: Capture, view: int, axis: int) -> NDArray[np.float64]:
    """(N, 3) height, least and greatest world coordinate of the silhouette, by rising height."""
    camera: Camera = capture.cameras[view]
    inside = load_mask(capture.image_path(view), camera.size) > 0.5
    rows = np.flatnonzero(inside.any(axis=1))
    if len(rows) < 2:
        raise MethodError(f"view {view} of {capture.subject} shows no subject")
    left = inside[rows].argmax(axis=1)
    right = camera.width - inside[rows, ::-1].argmax(axis=1)
    # The subject stands at the origin: its outline is taken to be as far away as that.
    depth = np.full(len(rows), -camera.position @ camera.forward)
    one = camera.unproject(np.stack([left, rows + 0.5], axis=1), depth)
    other = camera.unproject(np.stack([right, rows + 0.5], axis=1), depth)
    ends = np.sort(np.stack([one[:, axis], other[:, axis]], axis=1), axis=1)
    return np.column_stack([one[:, 1], ends])[::-1]


def _stack(
    heights: NDArray[np.float64],
    x: NDArray[np.float64],
    radius_x: NDArray[np.float64],
    z: NDArray[np.float64],
    radius_z: NDArray[np.float64],
) -> Mesh:
    """A closed mesh through one ellipse per height, in metres."""
    angle = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
    rings = np.stack(
        [
            x[:, None] + radius_x[:, None] * np.sin(angle),
            np.broadcast_to(heights[:, None], (len(heights), _CORNERS)),
            z[:, None] + radius_z[:, None] * np.cos(angle),
        ],
        axis=-1,
    )
    ends = np.array([[x[0], heights[0], z[0]], [x[-1], heights[-1], z[-1]]])
    index = np.arange(rings.shape[0] * _CORNERS).reshape(-1, _CORNERS)
    following = np.roll(index, -1, axis=1)
    a, b, c, d = index[:-1], following[:-1], following[1:], index[1:]
    bottom, top = index.size, index.size + 1
    faces = [
        np.stack([a, b, c], -1).reshape(-1, 3),
        np.stack([a, c, d], -1).reshape(-1, 3),
        np.stack([np.full(_CORNERS, bottom), following[0], index[0]], -1),
        np.stack([np.full(_CORNERS, top), index[-1], following[-1]], -1),
    ]
    return Mesh(np.concatenate([rings.reshape(-1, 3), ends]), np.concatenate(faces))


ellipse_stack = EllipseStack()
