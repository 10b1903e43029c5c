"""One body fitted to usable views: single views, their average, all landmarks, JMBO."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.core.arrays import Floats
from harness.core.artifacts import Body, BodyLandmarks
from harness.core.camera import Camera
from harness.core.protocols import Context
from harness.geometry.place import UNTOLD_DEPTH_M, no_depth_is_told
from methods.body.fit.jmbo import NormalsOf, optimise
from methods.body.fit.landmark_fit import (
    average,
    average_of_columns,
    fit_each_view,
    fit_jointly,
    swapped_views,
)
from methods.body.models.model import MAIN_JOINTS, Parameters, ParametricBody, Posed
from methods.body.photos.views import View, Views
from methods.body.settings import BodyFitResult, FitCost, FitSettings

if TYPE_CHECKING:
    from torch import Tensor


def fit_frame(views: Views) -> Floats:
    """(4, 4) from the world to the fit's frame: the subject's place at its origin, up as before.

    The first camera stands towards +Z, wherever it is in the world.
    """
    first = views.views[0]
    towards = first.camera.eye_of(first.place.centre[None])[0] - first.place.centre
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


#: Makes what estimates the clothed normals of some views: called with the views, and the (4, 4)
#: from the world to the frame that their cameras are in.
NormalsIn = Callable[[Views, Floats], NormalsOf]

#: Makes the first body of each of some views: called with the views, and the (4, 4) from the world
#: to the frame that their cameras are in.
FirstIn = Callable[[Views, Floats], "dict[str, Tensor]"]

#: A hand is there when it was found in at least this share of a photo's readings.
_HAND_FOUND = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class FittedParameters:
    """Parameters of the one body that views agree on; ``swapped`` and ``cost`` as in the result."""

    parameters: dict[str, Tensor]
    swapped: tuple[int, ...] | None = None
    cost: FitCost | None = None


def fit_body(
    body: ParametricBody,
    views: Views,
    settings: FitSettings,
    context: Context,
    normals_in: NormalsIn | None = None,
    first_in: FirstIn | None = None,
) -> BodyFitResult:
    """The body that the views agree on, world metres.

    Args:
        body: The body model, with the landmarks that it is fitted by.
        views: Usable views of one capture.
        settings: How far the fit goes, and the weights of its cost.
        context: Seed and stages.
        normals_in: Estimates clothed normals, for a fit that compares normals with a network's.
        first_in: Makes the first body of each view; None fits them to the views' landmarks.
    """
    with _one_thread():
        fit = fitted_parameters(body, views, settings, context, normals_in, first_in)
    left, right = views.detections.hands[0] >= _HAND_FOUND
    return BodyFitResult(
        body=_exported(body, fit.parameters),
        views_used=views.indices,
        hands_found=(bool(left), bool(right)),
        regions=body.regions,
        views_left_out=views.left_out,
        depth=_depth_of(views.views, is_regressed=first_in is not None),
        swapped=fit.swapped,
        cost=fit.cost,
    )


def _depth_of(views: Sequence[View], *, is_regressed: bool) -> str:
    """What decides how far away the body of a single view is; nothing of several."""
    if len(views) > 1:
        return ""
    if views[0].place.depth_is_known:
        return "held at the subject's given centre"
    if no_depth_is_told([views[0].camera]):
        return (
            "one orthographic view does not tell it: the subject is put "
            f"{UNTOLD_DEPTH_M} m from the camera's origin"
        )
    first = (
        "the size of the first body that a network regressed"
        if is_regressed
        else "the body model's height prior"
    )
    return f"one view cannot tell size from distance: {first} decides"


def fitted_parameters(
    body: ParametricBody,
    views: Views,
    settings: FitSettings,
    context: Context,
    normals_in: NormalsIn | None = None,
    first_in: FirstIn | None = None,
) -> FittedParameters:
    """As ``fit_body``, in the body model's own parameters, world frame."""
    world_to_fit = fit_frame(views)
    views = in_frame(views, world_to_fit)
    with context.stage("single views"):
        if first_in is None:
            parameters = average(fit_each_view(body.sparse(), views.views, views.detections))
        else:
            parameters = average_of_columns(first_in(views, world_to_fit))
    swapped, cost = None, None
    if settings.stage in ("landmarks", "jmbo") and "landmarks" in (settings.stage, settings.start):
        with context.stage("joint landmarks"):
            views, parameters, swapped = _joint_landmarks(body, views, parameters)
    if settings.stage == "jmbo":
        normals_of = None
        if normals_in is not None:
            with context.stage("normals"):
                normals_of = normals_in(views, world_to_fit)
                views = _with_normals(body, views, parameters, normals_of)
        with context.stage("jmbo"):
            fit = optimise(body, views, parameters, settings, context.seed, normals_of)
        parameters, cost = fit.parameters, FitCost(fit.costs, fit.terms, fit.ended)
    return FittedParameters(out_of_frame(parameters, world_to_fit), swapped, cost)


def _joint_landmarks(
    body: ParametricBody, views: Views, start: Parameters
) -> tuple[Views, dict[str, Tensor], tuple[int, ...]]:
    """The views with left and right put right, the body of their landmarks, the swapped views."""
    sparse = body.sparse()
    parameters = fit_jointly(sparse, views.views, views.detections, start)
    swapped = swapped_views(sparse, views.views, views.detections, parameters)
    if swapped.any():
        views = replace(views, detections=views.detections.mirrored(swapped))
        parameters = fit_jointly(sparse, views.views, views.detections, parameters)
    indices = zip(views.indices, swapped, strict=True)
    return views, parameters, tuple(index for index, is_swapped in indices if is_swapped)


def _with_normals(
    body: ParametricBody, views: Views, start: Parameters, normals_of: NormalsOf
) -> Views:
    """The views with the normals that are estimated with the body that the fit starts from."""
    normals = normals_of(_posed(body, start).vertices[0].double().numpy())
    seen = zip(views.views, normals, strict=True)
    return replace(views, views=tuple(replace(view, normals_camera=map_) for view, map_ in seen))


def _exported(body: ParametricBody, parameters: Parameters) -> Body:
    posed = _posed(body, parameters)
    points = body.landmark_points(posed)
    return Body(
        model=body.name,
        vertices=posed.vertices[0].double().numpy(),
        joints=posed.joints[0].double().numpy(),
        faces=body.faces,
        parameters=body.export(parameters),
        joint_names=body.joint_names,
        main_joints=np.array([body.roles[role] for role in MAIN_JOINTS]),
        landmarks=BodyLandmarks(body.landmarks.landmarks, points[0].double().numpy()),
    )


def _posed(body: ParametricBody, parameters: Parameters) -> Posed:
    import torch

    with torch.no_grad():
        return body.posed(parameters)


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Small tensors: a second thread only spins, and sums keep one order for equal results."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
