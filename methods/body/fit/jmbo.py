"""JMBO: one body fitted jointly to the silhouettes, normals and landmarks of N calibrated views.

Source: MExECON, section "Joint Multi-view Body Optimization". The cost is the paper's; the
authors' code differs from it in ways that are not followed here: its normal term is signed, its
head weight is 0.3, its landmarks are mirrored against its silhouettes, and it looks at every view
through an orthographic crop that knows of the cameras nothing but their rotation. Every view here
has its full perspective camera, wherever it stands and however it is pitched.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from harness.core.arrays import Floats
from harness.core.camera import Camera
from harness.geometry.raycast import Hits
from methods.body.fit.descent import Adam, Plateau
from methods.body.fit.evidence import Evidence, Projector, length
from methods.body.fit.losses import (
    BodySurface,
    NormalTarget,
    SilhouetteTarget,
    Skin,
    Topology,
    normal_cost,
    silhouette_cost,
    uncovered_cost,
    vertex_normals,
)
from methods.body.fit.weights import (
    PUBLISHED_CONFIDENCE,
    PUBLISHED_LANDMARKS,
    ParameterPrior,
    Weights,
)
from methods.body.models.model import LandmarkTable, Parameters, ParametricBody, Posed, box_middle
from methods.body.photos.views import View, Views

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkTarget:
    """Where a view's landmarks should be seen.

    Attributes:
        projector: The view.
        pixels: (K, 2) working pixels.
        weight: (K,) confidence of each landmark that counts, 0 for the others.
        side_px: Side of the subject's frame, which the cost is divided by.
    """

    projector: Projector
    pixels: Tensor
    weight: Tensor
    side_px: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class ViewTarget:
    """What one view asks of the body; ``normals`` is None where the view has none."""

    silhouette: SilhouetteTarget
    landmarks: LandmarkTarget
    normals: NormalTarget | None


@dataclass(frozen=True, slots=True, eq=False)
class BodyState:
    """The body at one iteration, world metres.

    Attributes:
        skin: Its vertices, their normals and its faces.
        points: (K, 3) its landmarks.
        surface: The same vertices as a surface that rays can meet.
        hits: What the rays of the view meet, where they have been cast already.
    """

    skin: Skin
    points: Tensor
    surface: BodySurface
    hits: Hits | None = None


def silhouette_term(body: BodyState, view: ViewTarget) -> Tensor:
    """Area between the two silhouettes, as a share of the subject's frame.

    Source: MExECON, equation of the silhouette loss (L1).
    """
    mask = None if body.hits is None else body.hits.mask
    return silhouette_cost(body.skin.vertices, body.surface, view.silhouette, mask)


def normal_term(body: BodyState, view: ViewTarget) -> Tensor:
    """Mean absolute difference of normals where body and subject overlap; 0 without normals.

    Source: MExECON, equation of the normal loss (L1).
    """
    if view.normals is None:
        return body.skin.vertices.sum() * 0.0
    hits = body.hits or body.surface.caster.cast(view.normals.projector.camera)
    return normal_cost(body.skin, hits, view.normals)


def landmark_term(body: BodyState, view: ViewTarget) -> Tensor:
    """Mean distance of landmarks in the picture, in sides of the subject's frame.

    Source: MExECON, equation of the landmark loss: mean of distances weighted by confidence, whose
    picture is one unit wide in the authors' code.
    """
    target = view.landmarks
    distance = length(target.projector(body.points) - target.pixels)
    weight = target.weight
    return (weight * distance).sum() / weight.sum().clamp_min(1e-6) / target.side_px


def head_cost(body: ParametricBody, posed: Posed) -> Tensor:
    """1 - cosine between the head's own upward axis and the world's.

    Source: MExECON, equation of the head loss, with both vectors of unit length.
    """
    return 1.0 - posed.turns[0, body.roles["head"], 1, 1]


#: Makes the clothed normals (H, W, 3) of every view, map frame, for one body's vertices (V, 3).
NormalsOf = Callable[[Floats], Sequence[Floats]]

_FACTOR, _PATIENCE, _LEAST_RATE = 0.5, 5, 1e-5
#: The ramp's shares of the iterations at which the full step is reached and left, and the first and
#: last share of the full step.
_FULL, _FALLING, _LEAST_SHARE = 0.1, 0.6, 0.1
#: Converged: the mean cost of this many iterations is less than this share below that of the same
#: number before. Not asked earlier than after three times as many.
_WINDOW, _IMPROVEMENT = 10, 2e-3
#: So many of the last iterates are averaged.
_LATE = 10


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How an optimisation went.

    Attributes:
        parameters: The one body's, as ``Weights.keep`` asks.
        costs: Total cost at each iteration.
        terms: Mean over views of each unweighted term, at the start and at the end.
        ended: ``converged`` or ``iterations``.
    """

    parameters: dict[str, Tensor]
    costs: tuple[float, ...]
    terms: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    ended: Literal["converged", "iterations"] = "iterations"


def optimise(
    body: ParametricBody,
    views: Views,
    start: Parameters,
    weights: Weights,
    seed: int,
    normals_of: NormalsOf | None = None,
) -> Fit:
    """The body that the views agree on best, starting from parameters of one body.

    Memory does not grow with the views: each view's gradient is added to the vertices' and its
    graph dropped before the next is looked at. ``batch`` bounds the time of an iteration as well.
    One view's body is held at the distance of the subject's place, or where that is not known at
    the distance that the start has.

    Args:
        body: Whose parameters are sought.
        views: Usable ones.
        start: Parameters of one body.
        weights: Weights of the cost, and how it is brought down.
        seed: Seed of the order of mini-batches.
        normals_of: Estimates the views' normals anew; asked every ``weights.normals_every``
            iterations.
    """
    problem = _Problem(body, views, weights)
    held_m = _held_distance_m(body, views, start)
    parameters = {name: value.detach().clone().requires_grad_() for name, value in start.items()}
    optimiser = Adam(parameters.values(), weights.rate)
    plateau = Plateau(optimiser, _FACTOR, _PATIENCE, _LEAST_RATE)
    turns = _batches(len(views.views), weights, seed)
    costs: list[float] = []
    terms: list[dict[str, float]] = []
    kept: deque[dict[str, Tensor]] = deque(maxlen=_LATE if weights.keep == "mean" else 1)
    ended: Literal["converged", "iterations"] = "iterations"
    # With mini-batches the costs of two iterations are of different views.
    picks_best = weights.keep == "best" and not weights.batch
    for iteration, chosen in enumerate(turns):
        if held_m is not None:
            hold_depth(body, parameters, views.views[0].camera, held_m)
        if normals_of is not None and _is_due(iteration, weights.normals_every):
            problem.compare_with(normals_of(problem.vertices(parameters)))
        optimiser.zero_grad()
        if weights.schedule == "ramp":
            optimiser.rate = weights.rate * _ramp(iteration / len(turns))
        cost, found = problem.step(parameters, chosen)
        if not picks_best or not costs or cost < min(costs):
            kept.append({name: value.detach().clone() for name, value in parameters.items()})
        costs.append(cost)
        terms.append(found)
        optimiser.step()
        if weights.schedule == "plateau":
            plateau.step(cost)
        if weights.early_stop and not weights.batch and _converged(costs):
            ended = "converged"
            break
    mean = _mean(kept or [parameters])
    if held_m is not None and len(kept) > 1:
        hold_depth(body, mean, views.views[0].camera, held_m)
    return Fit(mean, tuple(costs), _first_and_kept(costs, terms, picks_best=picks_best), ended)


def _mean(kept: Sequence[Parameters]) -> dict[str, Tensor]:
    import torch

    with torch.no_grad():
        return {name: torch.stack([each[name] for each in kept]).mean(0) for name in kept[0]}


def _first_and_kept(
    costs: Sequence[float], terms: Sequence[Mapping[str, float]], *, picks_best: bool
) -> dict[str, tuple[float, float]]:
    """Each term at the start and at the last iterate that is kept; none where none was tried."""
    if not costs:
        return {}
    kept = int(np.argmin(costs)) if picks_best else -1
    return {name: (value, terms[kept][name]) for name, value in terms[0].items()}


def _batches(count: int, weights: Weights, seed: int) -> list[Sequence[int]]:
    """The views of each iteration; in mini-batches every view comes equally often."""
    if not weights.draws(count):
        return [range(count)] * weights.iterations
    generator = np.random.default_rng(seed)
    order: list[int] = []
    while len(order) < weights.iterations * weights.batch:
        order += generator.permutation(count).tolist()
    starts = range(0, weights.iterations * weights.batch, weights.batch)
    return [order[start : start + weights.batch] for start in starts]


def _ramp(progress: float) -> float:
    """Share of the full step at a progress from 0 to 1."""
    rising = min(1.0, _LEAST_SHARE + (1.0 - _LEAST_SHARE) * progress / _FULL)
    falling = max(0.0, progress - _FALLING) / (1.0 - _FALLING)
    return rising * (1.0 - (1.0 - _LEAST_SHARE) * falling)


def _is_due(iteration: int, every: int) -> bool:
    """Whether normals are estimated anew; the views bring those of the start along."""
    return every > 0 and iteration > 0 and iteration % every == 0


def _converged(costs: Sequence[float]) -> bool:
    if len(costs) < 3 * _WINDOW:
        return False
    before, after = np.mean(costs[-2 * _WINDOW : -_WINDOW]), np.mean(costs[-_WINDOW:])
    return bool(0 <= before - after < _IMPROVEMENT * before)


def hold_depth(
    body: ParametricBody, parameters: dict[str, Tensor], camera: Camera, distance_m: float
) -> None:
    """Move one body along a camera's axis until the middle of its box is at a distance, metres.

    One view does not tell size from distance: left free, a body walks away and grows.
    """
    import torch

    forward = torch.tensor(camera.forward).to(parameters["translation"])
    position = torch.tensor(camera.position.copy()).to(forward)
    with torch.no_grad():
        middle = box_middle(body.posed(parameters).vertices)
        off = (middle - position) @ forward - distance_m
        parameters["translation"] -= off[:, None] * forward


def _held_distance_m(body: ParametricBody, views: Views, start: Parameters) -> float | None:
    """The distance at which the body of a single view is held; None with more views."""
    import torch

    if len(views.views) != 1:
        return None
    view = views.views[0]
    if view.place.depth_is_known:
        return view.place.distance_m(view.camera)
    with torch.no_grad():
        middle = box_middle(body.posed(start).vertices)[0].double().numpy()
    return float(view.camera.forward @ (middle - view.camera.position))


class _Problem:
    """The cost of one body in all views."""

    def __init__(self, body: ParametricBody, views: Views, weights: Weights) -> None:
        self.body, self.weights = body, weights
        self.topology = Topology(body.faces)
        self.prior = ParameterPrior(body)
        self.views = views.views
        self.targets = _view_targets(body, views, weights)
        self.compare_with([view.normals_camera for view in views.views])

    def compare_with(self, normals_camera: Sequence[Floats | None]) -> None:
        """Take these normals (H, W, 3) of the views, map frame, from now on; None for none."""
        self.targets = [
            replace(target, normals=self._normal_target(view, normals))
            for target, view, normals in zip(self.targets, self.views, normals_camera, strict=True)
        ]

    def _normal_target(self, view: View, normals_camera: Floats | None) -> NormalTarget | None:
        if normals_camera is None or not self.weights.normal:
            return None
        return NormalTarget(Projector(view.camera), normals_camera, view.side_px**2)

    def vertices(self, parameters: Parameters) -> Floats:
        """(V, 3) world metres of the one body."""
        import torch

        with torch.no_grad():
            return self.body.posed(parameters).vertices[0].double().numpy()

    def step(self, parameters: Parameters, chosen: Sequence[int]) -> tuple[float, dict[str, float]]:
        """The cost, with its gradient added to the parameters', and the terms' means over views."""
        import torch

        posed = self.body.posed(parameters)
        vertices, points = posed.vertices[0], self.body.landmark_points(posed)[0]
        normals = vertex_normals(vertices, self.topology.faces_tensor)
        # Views are looked at one by one from these, so that only one view's graph is held.
        leaves = [made.detach().requires_grad_() for made in (vertices, points, normals)]
        skin = Skin(leaves[0], leaves[2], self.topology.faces_tensor)
        surface = BodySurface(vertices.detach().cpu().double().numpy(), self.topology)
        state = BodyState(skin, leaves[1], surface)
        total = 0.0
        sums: dict[str, float] = dict.fromkeys(("silhouette", "normal", "landmark"), 0.0)
        share = len(self.targets) / len(chosen)
        for view in chosen:
            terms = self._terms(state, self.targets[view])
            cost = share * sum(getattr(self.weights, name) * term for name, term in terms.items())
            if isinstance(cost, torch.Tensor):
                cost.backward()
                total += cost.item()
            for name, term in terms.items():
                sums[name] += term.item() / len(chosen)
        head = head_cost(self.body, posed)
        rest = self.weights.head * head + self.weights.prior * self.prior(parameters).sum()
        total += rest.item()
        for made, leaf in zip((vertices, points, normals), leaves, strict=True):
            if leaf.grad is not None:
                rest = rest + (leaf.grad * made).sum()
        rest.backward()
        return total, {**sums, "head": head.item()}

    def _terms(self, body: BodyState, view: ViewTarget) -> dict[str, Tensor]:
        """The terms of one view that count, by the names of their weights."""
        terms: dict[str, Tensor] = {}
        if view.normals is not None:
            # The silhouette takes its mask from the rays that the normals need anyway.
            body = replace(body, hits=body.surface.caster.cast(view.normals.projector.camera))
            terms["normal"] = normal_term(body, view)
        if self.weights.silhouette:
            terms["silhouette"] = silhouette_term(body, view)
        if self.weights.landmark:
            terms["landmark"] = landmark_term(body, view)
        return terms


def _view_targets(body: ParametricBody, views: Views, weights: Weights) -> list[ViewTarget]:
    """What each view asks for, without normals."""
    evidence = Evidence(views.views, views.detections, body.landmarks)
    counted = _counted(evidence, body.landmarks, weights.landmarks)
    metres_per_px: list[float] = evidence.metres_per_px.tolist()
    targets = []
    for index, view in enumerate(views.views):
        standoff_px = weights.standoff_m / metres_per_px[index]
        silhouette = SilhouetteTarget(
            Projector(view.camera),
            view.coverage,
            view.side_px**2,
            uncovered_cost(view.coverage, weights.uncovered, standoff_px),
        )
        landmarks = LandmarkTarget(
            evidence.projectors[index],
            evidence.pixels[index],
            evidence.confidence[index] * counted[index],
            evidence.side_px[index],
        )
        targets.append(ViewTarget(silhouette, landmarks, None))
    return targets


def _counted(evidence: Evidence, table: LandmarkTable, chosen: str) -> Tensor:
    """(N, K) 1 for each landmark that is compared, 0 for the others."""
    import torch

    if chosen == "all":
        return torch.ones_like(evidence.confidence)
    known = torch.from_numpy(np.isin(table.landmarks, PUBLISHED_LANDMARKS))
    trust = torch.from_numpy(table.trust).clamp_min(1e-6)
    return (known & (evidence.confidence / trust > PUBLISHED_CONFIDENCE)).to(evidence.confidence)
