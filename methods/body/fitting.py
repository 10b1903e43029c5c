"""One body fitted to usable views: single views, their average, all landmarks, JMBO."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.artifacts import Body, BodyLandmarks
from harness.core.camera import Camera
from harness.core.protocols import Context
from harness.core.typed_json import from_json, to_json
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
from methods.body.photos.agreement import agreed
from methods.body.photos.views import View, Views
from methods.body.settings import BodyFitResult, FitCost, FitSettings

if TYPE_CHECKING:
    from torch import Tensor

_PARAMETER, _REGION, _FACTS = "parameter_", "region_", "facts"
#: Arrays of ``Body.to_arrays`` that are named like parameters of the model and are none.
_JOINT_NAMES, _MAIN_JOINTS = "parameter_joint_names", "parameter_main_joints"
_LANDMARKS, _POINTS = "parameter_landmark_index", "parameter_landmark_points"


@dataclass(frozen=True, slots=True)
class _Facts:
    """What of a fit is no array; as in ``BodyFitResult``, with views as text."""

    views_used: tuple[int, ...]
    hands_found: tuple[bool, bool]
    views_left_out: Mapping[str, str]
    depth: str
    swapped: tuple[int, ...] | None
    cost: FitCost | None


def packed(fit: BodyFitResult) -> dict[str, NDArray[Any]]:
    """A fit in arrays by name."""
    facts = _Facts(
        fit.views_used,
        fit.hands_found,
        {str(view): why for view, why in fit.views_left_out.items()},
        fit.depth,
        fit.swapped,
        fit.cost,
    )
    text = json.dumps(to_json(facts)).encode()
    return {
        **fit.body.to_arrays(),
        **{f"{_REGION}{name}": mask for name, mask in fit.regions.items()},
        _FACTS: np.frombuffer(text, dtype=np.uint8),
    }


def unpacked(arrays: Mapping[str, NDArray[Any]]) -> BodyFitResult:
    """The fit behind ``packed``, equal to the bit.

    Raises:
        KeyError, ValueError, DataError: arrays that are not those of a fit.
    """
    facts = from_json(_Facts, json.loads(arrays[_FACTS].tobytes()), "a stored fit", "a body fit")
    return BodyFitResult(
        body=_body(arrays),
        views_used=facts.views_used,
        hands_found=facts.hands_found,
        regions={
            name.removeprefix(_REGION): mask
            for name, mask in arrays.items()
            if name.startswith(_REGION)
        },
        views_left_out={int(view): why for view, why in facts.views_left_out.items()},
        depth=facts.depth,
        swapped=facts.swapped,
        cost=facts.cost,
    )


def _body(arrays: Mapping[str, NDArray[Any]]) -> Body:
    others = (_JOINT_NAMES, _MAIN_JOINTS, _LANDMARKS, _POINTS)
    parameters = {
        name.removeprefix(_PARAMETER): values
        for name, values in arrays.items()
        if name.startswith(_PARAMETER) and name not in others
    }
    landmarks = None
    if _LANDMARKS in arrays:
        landmarks = BodyLandmarks(arrays[_LANDMARKS], arrays[_POINTS])
    body = Body(
        model=str(arrays["model"]),
        vertices=arrays["vertices"],
        joints=arrays["joints"],
        faces=arrays["faces"],
        parameters=parameters,
        landmarks=landmarks,
    )
    if _JOINT_NAMES not in arrays:
        return body
    names = tuple(str(name) for name in arrays[_JOINT_NAMES])
    return replace(body, joint_names=names, main_joints=arrays[_MAIN_JOINTS])


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
    starts_jointly = settings.stage == "jmbo" and settings.start == "landmarks"
    is_joint = settings.stage == "landmarks" or starts_jointly
    with context.stage("single views"):
        if first_in is None:
            # All landmarks are fitted together next, from where each view's own lead.
            told = views.detections if is_joint else agreed(views)
            parameters = average(fit_each_view(body.sparse(), views.views, told))
        else:
            parameters = average_of_columns(first_in(views, world_to_fit))
    swapped, cost = None, None
    if is_joint:
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
