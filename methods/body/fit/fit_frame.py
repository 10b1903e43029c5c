"""The frame that a body is fitted in: the first view's, so that results turn with the cameras.

The optimiser takes steps of equal size along the axes that parameters are described in. In the
world's axes its result would depend on which way they happen to point; the authors of MExECON
describe all bodies in the first view's frame, too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.cameras.camera import Camera
from methods.body.models.model import Parameters
from methods.body.photos.views import Views

if TYPE_CHECKING:
    from torch import Tensor


def fit_frame(views: Views) -> Floats:
    """(4, 4) from the world to the fit's frame: the subject's place at its origin, up as before.

    The first camera stands towards +Z, wherever it is in the world.
    """
    first = views.views[0]
    towards = first.camera.position - first.place.centre
    yaw = np.arctan2(towards[0], towards[2])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    frame = np.eye(4)
    frame[:3, :3] = [[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]]
    frame[:3, 3] = -frame[:3, :3] @ first.place.centre
    return frame


def in_frame(views: Views, world_to_fit: Floats) -> Views:
    """The views with cameras and place described in another frame."""

    def moved(camera: Camera) -> Camera:
        return camera.in_frame(world_to_fit)

    seen = []
    for view in views.views:
        centre = world_to_fit[:3, :3] @ view.place.centre + world_to_fit[:3, 3]
        place = replace(view.place, centre=centre)
        seen.append(replace(view, camera=moved(view.camera), place=place))
    return replace(views, views=tuple(seen))


def out_of_frame(parameters: Parameters, world_to_fit: Floats) -> dict[str, Any]:
    """Bodies' parameters in the world's frame, of those in the fit's."""
    import torch

    turn = torch.from_numpy(world_to_fit[:3, :3].copy()).to(parameters["translation"])
    shift = torch.from_numpy(world_to_fit[:3, 3].copy()).to(turn)
    translation: Tensor = parameters["translation"] - shift
    return {
        **parameters,
        "orientation": turn.T @ parameters["orientation"],
        "translation": translation @ turn,
    }
