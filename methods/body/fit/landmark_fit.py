"""Bodies from landmarks alone: one per view, their average, and one for all views together.

The fits to single views stand where the paper has PIXIE. One view cannot tell size from distance.
Where several views, or a privilege, tell how far away the subject is, a view's own body is held
there; otherwise the body model's prior of how tall people are decides, and what the detector takes
for metres does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.core.arrays import Floats
from harness.core.missing import compiler_left_out
from harness.core.process.threads import on_all_cores
from methods.body.fit.descent import Adam, cosine
from methods.body.fit.evidence import Evidence
from methods.body.fit.weights import ParameterPrior
from methods.body.models.model import Parameters, ParametricBody, box_middle, neutral
from methods.body.photos.detection import Detections
from methods.body.photos.views import View

if TYPE_CHECKING:
    from torch import Tensor

#: Step of the finite differences, in each parameter's own unit (radians, metres, shape values).
_STEP = 1e-6
_MOST_ROUNDS, _MOST_TRIES = 150, 10
#: A round that lowers the cost by less than this share of it is the last, if its derivatives were
#: worked out anew; else they are, after a round that lowers it by less than the second share.
_SETTLED, _SLOW = 1e-7, 1e-2


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """What B sets of parameters leave over.

    Attributes:
        robust: Groups (B, G, D) whose lengths cost half the logarithm of 1 + their square (Cauchy),
            and their weights (G,).
        plain: (B, L) that cost half their square.
    """

    robust: tuple[tuple[Tensor, Tensor], ...]
    plain: Tensor

    def cost(self) -> Tensor:
        """(B,) the sum of all costs."""
        total = 0.5 * (self.plain**2).sum(1)
        for group, weight in self.robust:
            total = total + 0.5 * (weight * (group**2).sum(2).log1p()).sum(1)
        return total

    def rows(self) -> Tensor:
        """(B, M) all numbers."""
        import torch

        return torch.cat([self.plain, *(group.flatten(1) for group, _ in self.robust)], 1)

    def weights(self) -> Tensor:
        """(M,) those of iteratively reweighted least squares at the first set.

        With them the squares' gradient is the gradient of the cost.
        """
        import torch

        weights = [torch.ones_like(self.plain[0])]
        for group, weight in self.robust:
            share = weight / (1.0 + (group[0] ** 2).sum(1))
            weights.append(share[:, None].expand(group.shape[1:]).flatten())
        return torch.cat(weights)


class Problem(Protocol):
    """What is to be minimised."""

    def about(self, parameters: Parameters) -> None:
        """Called with the parameters (1, ...) of each round: what is held fixed around them."""
        ...

    def residuals(self, parameters: Parameters) -> Residuals:
        """What parameters (B, ...) leave over."""
        ...


def minimum(problem: Problem, start: Parameters) -> tuple[dict[str, Tensor], float]:
    """The parameters (1, ...) of the minimum that a start (1, ...) leads to, and their cost.

    Args:
        problem: What is minimised.
        start: Any precision; the result has double precision.
    """
    import torch

    with torch.no_grad():
        return _Search(problem, start).run()


class _Search:
    """The way from a start to a minimum."""

    def __init__(self, problem: Problem, start: Parameters) -> None:
        import torch

        self._problem = problem
        self._shapes = {name: value.shape[1:] for name, value in start.items()}
        self._at = torch.cat([value.detach().double().flatten() for value in start.values()])
        self._damping = 1e-2

    def run(self) -> tuple[dict[str, Tensor], float]:
        """As ``minimum``."""
        import torch

        jacobian, fresh = None, False
        for _ in range(_MOST_ROUNDS):
            self._problem.about(self._unpacked(self._at[None]))
            here = self._left(self._at[None])
            if jacobian is None:
                jacobian, fresh = self._jacobian(), True
            step, there = self._tried(here, jacobian, _MOST_TRIES if fresh else 1)
            gain = float(here.cost() - there.cost())
            if gain > 0:
                self._at, self._damping = self._at + step, max(self._damping / 5, 1e-7)
            if gain > (_SETTLED if fresh else _SLOW) * float(here.cost()):
                # Broyden's update: the differences along the step, for a ninetieth of the work.
                missed = there.rows()[0] - here.rows()[0] - jacobian @ step
                jacobian, fresh = jacobian + torch.outer(missed, step) / (step @ step), False
            elif fresh:
                break
            else:
                jacobian = None
        return self._unpacked(self._at[None]), float(self._left(self._at[None]).cost())

    def _tried(
        self, here: Residuals, jacobian: Tensor, most_tries: int
    ) -> tuple[Tensor, Residuals]:
        """A step that lowers the cost, if one is found, and what is left over there."""
        import torch

        weighed = here.weights()[:, None] * jacobian
        normal, slope = jacobian.T @ weighed, weighed.T @ here.rows()[0]
        step, there = torch.zeros_like(slope), here
        for _ in range(most_tries):
            damped = normal + torch.diag(self._damping * normal.diagonal() + 1e-9)
            step = -torch.linalg.solve(damped, slope)
            there = self._left((self._at + step)[None])
            if float(there.cost()) < float(here.cost()):
                break
            self._damping *= 4
        return step, there

    def _jacobian(self) -> Tensor:
        """(M, P) by finite differences, all at once."""
        import torch

        moved = self._at + _STEP * torch.eye(len(self._at), dtype=self._at.dtype)
        rows = self._left(torch.cat([self._at[None], moved])).rows()
        return ((rows[1:] - rows[0]) / _STEP).T

    def _left(self, rows: Tensor) -> Residuals:
        return self._problem.residuals(self._unpacked(rows))

    def _unpacked(self, rows: Tensor) -> dict[str, Tensor]:
        parts = rows.split([shape.numel() for shape in self._shapes.values()], 1)
        return {
            name: part.reshape(-1, *shape)
            for (name, shape), part in zip(self._shapes.items(), parts, strict=True)
        }


def mean_rotation(rotations: Floats) -> Floats:
    """(3, 3) chordal mean of rotations (N, 3, 3): the one with the least sum of squared distances.

    Source: Hartley et al., Rotation averaging, IJCV 2013. Exact, and the same in whatever order.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotations).mean().as_matrix()


def mean_of_columns(rotations: Floats) -> Floats:
    """(3, 3) rotation of the mean first two columns of rotations (N, 3, 3), made perpendicular.

    MExECON averages so, in the six numbers that PIXIE answers with. Eight rotations that scatter by
    20 degrees have means 0.6 degrees apart by this and by ``mean_rotation``.
    """
    first, second = rotations[:, :, 0].mean(0), rotations[:, :, 1].mean(0)
    x = first / np.linalg.norm(first)
    y = second - (x @ second) * x
    y = y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def mean_rotation_vector(vectors: Floats) -> Floats:
    """(3,) rotation vector of the chordal mean of rotation vectors (N, 3), radians."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vectors).mean().as_rotvec()


def upright(left_world: Floats) -> Floats:
    """(3, 3) rotation of an upright body whose left hand points as ``left_world`` (3,) does.

    Its columns are the body's left, up and forward in world axes; a vector that is vertical or 0
    says nothing and gives the body that faces +Z.
    """
    left = np.array([left_world[0], 0.0, left_world[2]])
    length = np.linalg.norm(left)
    left = np.array([1.0, 0.0, 0.0]) if length < 1e-9 else left / length
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([left, up, np.cross(left, up)], axis=1)


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

    bodies = body, body.precise()

    def fitted(index: int) -> dict[str, Tensor]:
        view, seen = views[index], detections.at([index])
        points = seen.points_camera[0]
        across = view.camera.rotation.T @ (points[_LEFT] - points[_RIGHT]).sum(axis=0)
        start = neutral(body)
        start["orientation"] = torch.tensor(upright(across))[None, :, :2]
        start["translation"] = start["translation"] + torch.tensor(view.place.centre)
        return minimum(_Landmarks(bodies, (view,), seen), start)[0]

    found = on_all_cores(fitted, range(len(views)))
    return {name: torch.cat([each[name] for each in found]).float() for name in found[0]}


def average(parameters: Parameters) -> dict[str, Tensor]:
    """One body from N: rotations averaged on SO(3), places and shapes arithmetically.

    The orientations are in the world frame already, which the known cameras made common.
    """
    with compiler_left_out():
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
    problem = _Landmarks((body, body.precise()), views, detections)
    return _descend(problem, start, _JOINT_STEPS, _JOINT_RATE)


def _descend(problem: _Landmarks, start: Parameters, steps: int, rate: float) -> dict[str, Tensor]:
    """Parameters some way down from a start.

    What follows does better from here than from the minimum itself: a made body in eight views ends
    below 10 mm off, and 12.7 mm off from the minimum.
    """
    parameters = {name: value.detach().double().requires_grad_() for name, value in start.items()}
    optimiser = Adam(parameters.values(), rate)
    for step in range(steps):
        optimiser.zero_grad()
        problem.about({name: value.detach() for name, value in parameters.items()})
        problem.residuals(parameters).cost().sum().backward()
        optimiser.step()
        # Slower towards the end, so that it ends at a minimum and not somewhere round it.
        optimiser.rate = cosine(optimiser.rate, step + 1, steps, 0.05 * rate)
    return {name: value.detach().float() for name, value in parameters.items()}


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


class _Landmarks:
    """The cost of one body in N views: landmarks in the pictures and in space, prior, distance."""

    def __init__(
        self,
        bodies: tuple[ParametricBody, ParametricBody],
        views: tuple[View, ...],
        detections: Detections,
    ) -> None:
        import torch

        self._whole, self._body = bodies
        self._prior = ParameterPrior(self._body)
        table = self._body.landmarks
        self._seen = Evidence(views, detections, table, precise=True)
        self._hips = [int(np.flatnonzero(table.landmarks == hip)[0]) for hip in (23, 24)]
        place = views[0].place
        self._depth_is_known = place.depth_is_known
        self._centre = torch.tensor(place.centre)
        self._forward = torch.tensor(np.array([view.camera.forward for view in views]))
        self._to_middle = self._centre * 0.0

    def about(self, parameters: Parameters) -> None:
        """Hold the way from the root to the middle of the body's box.

        Place gives way and not pose, or a limb that reaches to the box's side would be drawn in.
        """
        if self._holds_depth():
            single = {name: value.float() for name, value in parameters.items()}
            middle = box_middle(self._whole.posed(single).vertices)[0].double()
            self._to_middle = middle - single["translation"][0]

    def residuals(self, parameters: Parameters) -> Residuals:
        """What the parameters (B, ...) leave over."""
        import torch

        points = self._body.landmark_points(self._body.posed(parameters))
        in_picture, in_space = [], []
        for view, projector in enumerate(self._seen.projectors):
            off_px = projector(points) - self._seen.pixels[view]
            in_picture.append(off_px * (self._seen.metres_per_px[view] / _PICTURE_M))
            in_space.append(self._off_in_space(projector.turn(points), view))
        weight = self._seen.confidence.flatten()
        plain = [self._prior.residuals(parameters)]
        if self._holds_depth():
            off = parameters["translation"] + self._to_middle - self._centre
            plain.append(off @ self._forward.T / _DEPTH_M)
        # What the detector says of depth counts as much as one view's, however many there are.
        return Residuals(
            (
                (torch.cat(in_picture, 1), weight),
                (torch.cat(in_space, 1), weight / len(self._seen)),
            ),
            torch.cat(plain, 1),
        )

    def _holds_depth(self) -> bool:
        # Nothing else holds the body of one orthographic view: it looks the same at any depth.
        told = self._depth_is_known or self._seen.projectors[0].camera.is_orthographic
        return told and len(self._seen) == 1

    def _off_in_space(self, turned: Tensor, view: int) -> Tensor:
        """(B, K, 3) between landmarks in camera axes and the detector's own, hips on hips.

        Where the views do not tell how far away the subject is, the detector's landmarks are made
        as large as these first: its metres are a mean person's, and would pass for a measurement.
        """
        about_hips = turned - turned[:, self._hips].mean(1, keepdim=True)
        own = self._seen.points_camera[view]
        if self._depth_is_known:
            return (about_hips - own) / _SPACE_M
        weights = self._seen.confidence[view][:, None]
        size = (weights * own * about_hips).sum((1, 2), keepdim=True) / (weights * own**2).sum()
        return (about_hips - size * own) / _SPACE_ALONE_M
