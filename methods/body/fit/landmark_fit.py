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
from methods.body.fit.descent import Adam, cosine
from methods.body.fit.evidence import Evidence, Projectors
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
            and their weights (B, G).
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
        """(B, M) those of iteratively reweighted least squares.

        With them the squares' gradient is the gradient of the cost.
        """
        import torch

        weights = [torch.ones_like(self.plain)]
        for group, weight in self.robust:
            share = weight / (1.0 + (group**2).sum(2))
            weights.append(share[:, :, None].expand(group.shape).flatten(1))
        return torch.cat(weights, 1)


class Problem(Protocol):
    """N things to be minimised, each by parameters of its own."""

    def about(self, parameters: Parameters, which: Tensor) -> None:
        """Called with the parameters (B, ...) of each round: what is held fixed around them."""
        ...

    def residuals(self, parameters: Parameters, which: Tensor) -> Residuals:
        """What parameters (B, ...) leave over of the things (B,) that they are of."""
        ...


def minimum(problem: Problem, start: Parameters) -> tuple[dict[str, Tensor], Tensor]:
    """The parameters (N, ...) of the minima that starts (N, ...) lead to, and their costs (N,).

    Args:
        problem: What is minimised: N things at once, because a small step costs as much as many.
        start: Any precision; the result has double precision.
    """
    import torch

    with torch.no_grad():
        return _Search(problem, start).run()


class _Search:
    """The ways from starts to minima."""

    def __init__(self, problem: Problem, start: Parameters) -> None:
        import torch

        self._problem = problem
        self._shapes = {name: value.shape[1:] for name, value in start.items()}
        self._at = torch.cat([value.detach().double().flatten(1) for value in start.values()], 1)
        self._damping = self._at.new_full((len(self._at),), 1e-2)

    def run(self) -> tuple[dict[str, Tensor], Tensor]:
        """As ``minimum``."""
        import torch

        left = every = torch.arange(len(self._at))
        jacobian = self._at.new_zeros(0)
        fresh = torch.zeros(len(every), dtype=torch.bool)
        stale = ~fresh
        for _ in range(_MOST_ROUNDS):
            self._problem.about(self._unpacked(self._at[left]), left)
            if len(anew := left[stale[left]]):
                found = self._jacobian(anew)
                jacobian = found if len(anew) == len(every) else jacobian.index_copy(0, anew, found)
                fresh[anew], stale[anew] = True, False
            here = self._left(self._at[left], left)
            step, rows, gain = self._tried(left, here, jacobian[left], fresh[left])
            better = gain > 0
            self._at[left] += step * better[:, None]
            eased = (self._damping[left] / 5).clamp_min(1e-7)
            self._damping[left] = torch.where(better, eased, self._damping[left])
            went = gain > torch.where(fresh[left], _SETTLED, _SLOW) * here.cost()
            on, along = left[went], step[went]
            # Broyden's update: the differences along the step, for a ninetieth of the work.
            missed = rows[went] - here.rows()[went] - (jacobian[on] @ along[:, :, None])[..., 0]
            share = along / (along**2).sum(1, keepdim=True)
            jacobian[on] += missed[:, :, None] * share[:, None]
            stale[left] = ~went
            left = left[went | ~fresh[left]]
            fresh[on] = False
            if not len(left):
                break
        return self._unpacked(self._at), self._left(self._at, every).cost()

    def _tried(
        self, which: Tensor, here: Residuals, jacobian: Tensor, fresh: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Steps (B, P) that lower the costs, if some are found, the rows there, and by how much.

        Along derivatives that are not fresh, one step is tried.
        """
        import torch

        weighed = here.weights()[:, :, None] * jacobian
        normal = jacobian.transpose(1, 2) @ weighed
        slope = (weighed.transpose(1, 2) @ here.rows()[:, :, None])[..., 0]
        before, rows = here.cost(), here.rows().clone()
        step, gain = torch.zeros_like(slope), torch.zeros_like(before)
        tried = torch.arange(len(which))
        for number in range(_MOST_TRIES):
            tried = tried[fresh[tried]] if number else tried
            if not len(tried):
                break
            of = which[tried]
            most = normal[tried].diagonal(dim1=1, dim2=2)
            damped = normal[tried] + torch.diag_embed(self._damping[of, None] * most + 1e-9)
            step[tried] = -torch.linalg.solve(damped, slope[tried])
            there = self._left(self._at[of] + step[tried], of)
            rows[tried], gain[tried] = there.rows(), before[tried] - there.cost()
            tried = tried[~(gain[tried] > 0)]
            self._damping[which[tried]] *= 4
        return step, rows, gain

    def _jacobian(self, which: Tensor) -> Tensor:
        """(B, M, P) by finite differences, all at once."""
        import torch

        count = self._at.shape[1]
        moves = _STEP * torch.eye(count + 1, count, dtype=self._at.dtype).roll(1, 0)
        moved = self._at[which][:, None] + moves
        left = self._left(moved.flatten(0, 1), which.repeat_interleave(count + 1))
        rows = left.rows().unflatten(0, (len(which), count + 1))
        return ((rows[:, 1:] - rows[:, :1]) / _STEP).transpose(1, 2)

    def _left(self, rows: Tensor, which: Tensor) -> Residuals:
        return self._problem.residuals(self._unpacked(rows), which)

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

    starts: list[dict[str, Tensor]] = []
    for view, points in zip(views, detections.points_camera, strict=True):
        across = view.camera.rotation.T @ (points[_LEFT] - points[_RIGHT]).sum(axis=0)
        start = neutral(body)
        start["orientation"] = torch.tensor(upright(across))[None, :, :2]
        start["translation"] = start["translation"] + torch.tensor(view.place.centre)
        starts.append(start)
    joined = {name: torch.cat([each[name] for each in starts]) for name in starts[0]}
    problem = _Landmarks((body, body.precise()), views, detections, each=True)
    return {name: value.float() for name, value in minimum(problem, joined)[0].items()}


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
    import torch

    parameters = {name: value.detach().double().requires_grad_() for name, value in start.items()}
    optimiser = Adam(parameters.values(), rate)
    only = torch.zeros(1, dtype=torch.long)
    for step in range(steps):
        optimiser.zero_grad()
        problem.about({name: value.detach() for name, value in parameters.items()}, only)
        problem.residuals(parameters, only).cost().sum().backward()
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
    """The cost of bodies in N views: landmarks in the pictures and in space, prior, distance.

    Args:
        bodies: One with vertices enough for its extent, and the same in double precision.
        views: N views.
        detections: The landmarks found in these views.
        each: Whether each view has a body of its own; else all see the same one.
    """

    def __init__(
        self,
        bodies: tuple[ParametricBody, ParametricBody],
        views: tuple[View, ...],
        detections: Detections,
        *,
        each: bool = False,
    ) -> None:
        import torch

        self._whole, self._body = bodies
        self._prior = ParameterPrior(self._body)
        self._each = each
        table = self._body.landmarks
        self._seen = Evidence(views, detections, table, precise=True)
        self._project = Projectors([view.camera for view in views])
        self._hips = [int(np.flatnonzero(table.landmarks == hip)[0]) for hip in (23, 24)]
        known = [view.place.depth_is_known for view in views]
        # Nothing else holds the body of one orthographic view: it looks the same at any depth.
        parallel = [view.camera.is_orthographic for view in views]
        self._depth_is_known = torch.tensor(known)
        self._holds_depth = torch.tensor(np.logical_or(known, parallel) & (each or len(views) == 1))
        self._centre = torch.tensor(np.array([view.place.centre for view in views]))
        self._forward = torch.tensor(np.array([view.camera.forward for view in views]))
        self._to_middle = self._centre * 0.0

    def about(self, parameters: Parameters, which: Tensor) -> None:
        """Hold the way from the root to the middle of the body's box.

        Place gives way and not pose, or a limb that reaches to the box's side would be drawn in.
        """
        holds = self._holds_depth[which]
        if holds.any():
            single = {name: value[holds].float() for name, value in parameters.items()}
            middle = box_middle(self._whole.posed(single).vertices).double()
            self._to_middle[which[holds]] = middle - single["translation"]

    def residuals(self, parameters: Parameters, which: Tensor) -> Residuals:
        """What the parameters (B, ...) leave over; each body is seen by its own view, or by all."""
        import torch

        points = self._body.landmark_points(self._body.posed(parameters))[:, None]
        view = which[:, None] if self._each else torch.arange(len(self._seen))[None]
        turned = self._project.turned(points, view)
        scale = (self._seen.metres_per_px[view] / _PICTURE_M)[..., None, None]
        in_picture = (self._project.pixels(turned, view) - self._seen.pixels[view]) * scale
        weight = self._seen.confidence[view].expand(in_picture.shape[:3])
        plain = [self._prior.residuals(parameters)]
        if (holds := self._holds_depth[which]).any():
            off = parameters["translation"] + self._to_middle[which] - self._centre[which]
            ahead = (off * self._forward[which]).sum(1) / _DEPTH_M
            plain.append((ahead * holds)[:, None])
        # What the detector says of depth counts as much as one view's, however many there are.
        return Residuals(
            (
                (in_picture.flatten(1, 2), weight.flatten(1)),
                (
                    self._off_in_space(turned, view).flatten(1, 2),
                    weight.flatten(1) / view.shape[1],
                ),
            ),
            torch.cat(plain, 1),
        )

    def _off_in_space(self, turned: Tensor, view: Tensor) -> Tensor:
        """(B, V, K, 3) between landmarks in camera axes and the detector's own, hips on hips.

        Where the views do not tell how far away the subject is, the detector's landmarks are made
        as large as these first: its metres are a mean person's, and would pass for a measurement.
        """
        import torch

        about_hips = turned - turned[..., self._hips, :].mean(-2, keepdim=True)
        own, weights = self._seen.points_camera[view], self._seen.confidence[view][..., None]
        size = (weights * own * about_hips).sum((-2, -1), keepdim=True)
        size = size / (weights * own**2).sum((-2, -1), keepdim=True)
        known = self._depth_is_known[view][..., None, None]
        sized = (about_hips - size * own) / _SPACE_ALONE_M
        return torch.where(known, (about_hips - own) / _SPACE_M, sized)
