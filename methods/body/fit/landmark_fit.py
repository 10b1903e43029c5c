"""Bodies from landmarks alone: one per view, their average, and one for all views together.

The fits to single views stand where the paper has PIXIE. One view cannot tell size from distance.
Where several views, or a privilege, tell how far away the subject is, a view's own body is held
there; otherwise the body model's prior of how tall people are decides, and what the detector takes
for metres does not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from methods.body.fit.evidence import Evidence
from methods.body.fit.prior import ParameterPrior
from methods.body.fit.rotations import (
    mean_of_columns,
    mean_rotation,
    mean_rotation_vector,
    upright,
)
from methods.body.models.model import Parameters, ParametricBody, Posed, box_middle, neutral
from methods.body.photos.detection import Detections
from methods.body.photos.views import View

if TYPE_CHECKING:
    from torch import Tensor

_SINGLE_STEPS, _SINGLE_RATE = 120, 0.05
_JOINT_STEPS, _JOINT_RATE = 150, 0.03
#: Standard deviations: of a landmark in the picture (as metres at the subject), of one in space.
_PICTURE_M, _SPACE_M = 0.02, 0.06
#: The latter where nothing tells how far away the subject is. On 36 training avatars 0.12 puts a
#: single view's body 1.0 % nearer than a person of its height would be (0.06: 1.4 %), and its
#: joints, once the distance is right, are 42.8 mm off (0.06: 44.2, 0.2: 46.4).
_SPACE_ALONE_M = 0.12
#: How far the middle of a single view's body may be from the subject's distance, metres.
_DEPTH_M = 0.02
_LEFT, _RIGHT = [11, 23], [12, 24]
#: A view is called swapped where the other labelling fits this many times better.
_CLEARLY = 1.5


def fit_each_view(
    body: ParametricBody, views: tuple[View, ...], detections: Detections
) -> dict[str, Tensor]:
    """Parameters of N bodies, each fitted to one view's 2-D and 3-D landmarks.

    Args:
        body: Sparse will do.
        views: N views.
        detections: The landmarks found in these views.
    """
    import torch

    evidence = Evidence(views, detections, body.landmarks)
    prior = ParameterPrior(body)
    start = neutral(body, len(views))
    turns = [
        upright(view.camera.rotation.T @ (points[_LEFT] - points[_RIGHT]).sum(axis=0))
        for view, points in zip(views, detections.points_camera, strict=True)
    ]
    start["orientation"] = torch.tensor(np.array(turns), dtype=torch.float32)[:, :, :2]
    start["translation"] = start["translation"] + evidence.centre

    def energy(parameters: Parameters) -> Tensor:
        posed = body.posed(parameters)
        landmarks = _landmark_terms(evidence, body.landmark_points(posed), 1.0).sum()
        return landmarks + prior(parameters).sum() + _off_depth(evidence, posed, parameters)

    return _descend(start, energy, _SINGLE_STEPS, _SINGLE_RATE)


def average(parameters: Parameters) -> dict[str, Tensor]:
    """One body from N: rotations averaged on SO(3), places and shapes arithmetically.

    The orientations are in the world frame already, which the known cameras made common.
    """
    import roma

    turns = roma.special_gramschmidt(parameters["orientation"]).double().numpy()
    pose = parameters["pose"].double().numpy()
    vectors = [mean_rotation_vector(pose[:, joint]) for joint in range(pose.shape[1])]
    return _one_body(parameters, mean_rotation(turns), np.array(vectors))


def average_of_columns(parameters: Parameters) -> dict[str, Tensor]:
    """As ``average``, with rotations averaged by their columns, as MExECON averages PIXIE's."""
    from scipy.spatial.transform import Rotation

    six = parameters["orientation"].mean(0).double().numpy()
    vectors = parameters["pose"].double().numpy()
    turns = [
        mean_of_columns(Rotation.from_rotvec(vectors[:, joint]).as_matrix())
        for joint in range(vectors.shape[1])
    ]
    pose = Rotation.from_matrix(np.array(turns)).as_rotvec()
    return _one_body(parameters, mean_of_columns(six[None]), pose)


def _one_body(parameters: Parameters, orientation: Floats, pose: Floats) -> dict[str, Tensor]:
    """The mean of N bodies whose rotations have been averaged: (3, 3), and vectors (J, 3)."""
    import torch

    return {
        "orientation": torch.tensor(orientation, dtype=torch.float32)[None, :, :2],
        "translation": parameters["translation"].mean(0, keepdim=True),
        "pose": torch.tensor(pose, dtype=torch.float32)[None],
        "shape": parameters["shape"].mean(0, keepdim=True),
    }


def fit_jointly(
    body: ParametricBody, views: tuple[View, ...], detections: Detections, start: Parameters
) -> dict[str, Tensor]:
    """One body fitted to the landmarks of all views; a few wrong ones do little.

    What the detector says of depth counts as much as one view's, however many there are: cameras
    that see a limb from two sides know better, but a front and a back view alone leave it open.
    """
    evidence = Evidence(views, detections, body.landmarks)
    prior = ParameterPrior(body)

    def energy(parameters: Parameters) -> Tensor:
        posed = body.posed(parameters)
        points = body.landmark_points(posed)
        cost = _landmark_terms(evidence, points, 1.0 / len(views)).sum() + prior(parameters).sum()
        return cost + _off_depth(evidence, posed, parameters) if len(views) == 1 else cost

    return _descend(start, energy, _JOINT_STEPS, _JOINT_RATE)


def swapped_views(
    body: ParametricBody, views: tuple[View, ...], detections: Detections, fitted: Parameters
) -> NDArray[np.bool_]:
    """(N,) views whose landmarks fit a body clearly better with left and right exchanged.

    The body is one that was fitted to all views, so that the cameras decide which views are odd.
    """
    import torch

    with torch.no_grad():
        points = body.landmark_points(body.posed(fitted))
        errors = []
        for found in (detections, detections.mirrored(np.ones(len(views), dtype=bool))):
            evidence = Evidence(views, found, body.landmarks)
            error = evidence.confidence * evidence.pixel_error(points)
            errors.append((error.sum(1) / evidence.confidence.sum(1)).numpy())
    return errors[0] > _CLEARLY * errors[1]


def _off_depth(evidence: Evidence, posed: Posed, parameters: Parameters) -> Tensor:
    """Cost of N views' own bodies for being nearer or farther than the subject's place.

    0 where the views do not tell its distance.
    """
    root = parameters["translation"]
    if not evidence.depth_is_known:
        return root.new_zeros(())
    # Place gives way and not pose, or a limb that reaches to the box's side would be drawn in.
    middle = root + (box_middle(posed.vertices) - root).detach() - evidence.centre
    return (0.5 * ((middle * evidence.forward).sum(1) / _DEPTH_M) ** 2).sum()


def _landmark_terms(evidence: Evidence, points: Tensor, space: float) -> Tensor:
    """(N, K) robust cost of landmarks in the pictures and, at some weight, in space."""
    in_picture_m = evidence.pixel_error(points) * evidence.metres_per_px[:, None]
    in_space_m = evidence.space_error(points.expand(len(evidence), -1, -1))
    space_m = _SPACE_M if evidence.depth_is_known else _SPACE_ALONE_M
    cost = _robust(in_picture_m / _PICTURE_M) + space * _robust(in_space_m / space_m)
    return evidence.confidence * cost


def _robust(ratio: Tensor) -> Tensor:
    """Half the square for small errors, growing as a logarithm for large ones (Cauchy)."""
    return 0.5 * (ratio**2).log1p()


def _descend(
    start: Parameters, energy: Callable[[Parameters], Tensor], steps: int, rate: float
) -> dict[str, Tensor]:
    import torch

    parameters = {name: value.detach().clone().requires_grad_() for name, value in start.items()}
    optimiser = torch.optim.Adam(list(parameters.values()), lr=rate, amsgrad=True)
    # Slower towards the end, so that it ends at a minimum and not somewhere round it.
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps, eta_min=0.05 * rate)
    for _ in range(steps):
        optimiser.zero_grad()
        energy(parameters).backward()
        optimiser.step()
        schedule.step()
    return {name: value.detach() for name, value in parameters.items()}
