"""JMBO: one body fitted jointly to the silhouettes, normals and landmarks of N calibrated views.

Source: MExECON, section "Joint Multi-view Body Optimization". The cost is the paper's; the
authors' code differs from it in ways that are not followed here: its normal term is signed, its
head weight is 0.3, its landmarks are mirrored against its silhouettes, and it looks at every view
through an orthographic crop that knows of the cameras nothing but their rotation. Every view here
has its full perspective camera, wherever it stands and however it is pitched.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from harness.core.camera import Camera
from methods.body.evidence import Evidence
from methods.body.model import Parameters, ParametricBody, Posed, box_middle
from methods.body.normal_maps import NormalTarget, Skin, normal_cost
from methods.body.prior import BodyPrior
from methods.body.projection import Projector
from methods.body.silhouette import SilhouetteTarget, clothed, silhouette_cost
from methods.body.surface import BodySurface, Topology, vertex_normals
from methods.body.views import Views

if TYPE_CHECKING:
    from torch import Tensor

__all__ = ["Fit", "Weights", "head_cost", "hold_depth", "optimise"]

_FACTOR, _PATIENCE, _LEAST_RATE = 0.5, 5, 1e-5
#: Of the ramp: shares of the iterations at which the full step is reached and left, first and last
#: share of the full step.
_FULL, _FALLING, _LEAST_SHARE = 0.1, 0.6, 0.1
#: Converged: the mean cost of this many iterations is less than this share below that of the same
#: number before. Not asked earlier than after three times as many.
_WINDOW, _IMPROVEMENT = 10, 2e-3


@dataclass(frozen=True, slots=True)
class Weights:
    """The cost and how it is brought down. The defaults are the paper's equation.

    Attributes:
        silhouette, normal, landmark, head: Of the terms; 0 turns one off.
        uncovered: Weight, within the silhouette term, of subject that the body does not cover: 1
            is the paper's L1; less lets clothes stand off the body.
        standoff_m: Width of the subject's rim that costs nothing when uncovered, metres; 0 in the
            paper's L1.
        prior: Of the pose and shape prior; the paper has none.
        iterations: At most.
        rate: Adam's first step.
        schedule: ``plateau`` halves the step after 5 iterations without progress, as in the paper;
            ``ramp`` starts with small steps, for Adam's first ones are blind, and ends with them.
        batch: Views per iteration; 0 takes all.
    """

    silhouette: float = 1.0
    normal: float = 0.2
    landmark: float = 0.1
    head: float = 0.1
    uncovered: float = 1.0
    standoff_m: float = 0.0
    prior: float = 0.0
    iterations: int = 35
    rate: float = 1e-2
    schedule: str = "plateau"
    batch: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How an optimisation went.

    Attributes:
        parameters: Of the one body, with the least cost that was met.
        costs: Total cost at each iteration.
        terms: Mean over views of each unweighted term, at the start and at the end.
        ended: ``converged`` or ``iterations``.
    """

    parameters: dict[str, Tensor]
    costs: tuple[float, ...]
    terms: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    ended: Literal["converged", "iterations"] = "iterations"


def optimise(
    body: ParametricBody, views: Views, start: Parameters, weights: Weights, seed: int
) -> Fit:
    """The body that the views agree on best, starting from parameters of one body.

    Memory does not grow with the views: each view's gradient is added to the vertices' and its
    graph dropped before the next is looked at. ``batch`` bounds the time of an iteration as well.
    One view's body is held at the distance of the world's origin, where the first fit put it.
    """
    import torch

    problem = _Problem(body, views, weights)
    parameters = {name: value.detach().clone().requires_grad_() for name, value in start.items()}
    optimiser = torch.optim.Adam(list(parameters.values()), lr=weights.rate, amsgrad=True)
    plateau = torch.optim.lr_scheduler.ReduceLROnPlateau(
        optimiser, factor=_FACTOR, patience=_PATIENCE, min_lr=_LEAST_RATE
    )
    turns = _batches(len(views.views), weights, seed)
    costs: list[float] = []
    terms: list[dict[str, float]] = []
    best = {name: value.detach().clone() for name, value in parameters.items()}
    ended: Literal["converged", "iterations"] = "iterations"
    for iteration, chosen in enumerate(turns):
        if len(views.views) == 1:
            hold_depth(body, parameters, views.views[0].camera)
        optimiser.zero_grad()
        if weights.schedule == "ramp":
            optimiser.param_groups[0]["lr"] = weights.rate * _ramp(iteration / len(turns))
        cost, found = problem.step(parameters, chosen)
        # With mini-batches the costs of two iterations are of different views: the last one counts.
        if not costs or cost < min(costs) or weights.batch:
            best = {name: value.detach().clone() for name, value in parameters.items()}
        costs.append(cost)
        terms.append(found)
        optimiser.step()
        if weights.schedule == "plateau":
            plateau.step(cost)
        if not weights.batch and _converged(costs):
            ended = "converged"
            break
    last = int(np.argmin(costs)) if not weights.batch else -1
    pairs = {name: (terms[0][name], terms[last][name]) for name in terms[0]} if terms else {}
    return Fit(best, tuple(costs), pairs, ended)


def _batches(count: int, weights: Weights, seed: int) -> list[Sequence[int]]:
    """The views of each iteration; in mini-batches every view comes equally often."""
    if not 0 < weights.batch < count:
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


def _converged(costs: Sequence[float]) -> bool:
    if len(costs) < 3 * _WINDOW:
        return False
    before, after = np.mean(costs[-2 * _WINDOW : -_WINDOW]), np.mean(costs[-_WINDOW:])
    return bool(0 <= before - after < _IMPROVEMENT * before)


def hold_depth(body: ParametricBody, parameters: dict[str, Tensor], camera: Camera) -> None:
    """Move one body along a camera's axis until the middle of its box is as far as the origin.

    One view does not tell size from distance: left free, a body walks away and grows.
    """
    import torch

    forward = torch.tensor(camera.forward).to(parameters["translation"])
    with torch.no_grad():
        middle = box_middle(body.posed(parameters).vertices)
        parameters["translation"] -= (middle @ forward)[:, None] * forward


def head_cost(body: ParametricBody, posed: Posed) -> Tensor:
    """1 - cosine between the head's own upward axis and the world's.

    Source: MExECON, equation of the head loss, with both vectors of unit length.
    """
    return 1.0 - posed.turns[0, body.roles["head"], 1, 1]


class _Problem:
    """The cost of one body in all views."""

    def __init__(self, body: ParametricBody, views: Views, weights: Weights) -> None:
        self.body, self.weights = body, weights
        self.topology = Topology(body.faces)
        self.prior = BodyPrior(body)
        self.evidence = Evidence(views.views, views.detections, body.landmarks)
        self.silhouettes = [
            SilhouetteTarget(
                Projector(view.camera),
                view.coverage,
                view.side_px**2,
                clothed(view.coverage, weights.uncovered, weights.standoff_m / metres),
            )
            for view, metres in zip(views.views, self.evidence.metres_per_px.tolist(), strict=True)
        ]
        self.normals = [
            None
            if view.normals_camera is None
            else NormalTarget(Projector(view.camera), view.normals_camera, view.side_px**2)
            for view in views.views
        ]

    def step(self, parameters: Parameters, chosen: Sequence[int]) -> tuple[float, dict[str, float]]:
        """The cost, with its gradient added to the parameters', and the terms' means over views."""
        import torch

        posed = self.body.posed(parameters)
        vertices, points = posed.vertices[0], self.body.landmark_points(posed)[0]
        normals = vertex_normals(vertices, self.topology.faces_tensor)
        # Views are looked at one by one from these, so that only one view's graph is held.
        leaves = [made.detach().requires_grad_() for made in (vertices, points, normals)]
        surface = BodySurface(vertices.detach().cpu().double().numpy(), self.topology)
        total = 0.0
        sums: dict[str, float] = dict.fromkeys(("silhouette", "normal", "landmark"), 0.0)
        share = len(self.silhouettes) / len(chosen)
        for view in chosen:
            terms = self._terms(view, leaves, surface)
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

    def _terms(
        self, view: int, leaves: Sequence[Tensor], surface: BodySurface
    ) -> dict[str, Tensor]:
        vertices, points, normals = leaves
        terms, hits = {}, None
        wanted = self.normals[view] if self.weights.normal else None
        if wanted is not None:
            hits = surface.caster.cast(wanted.projector.camera)
            skin = Skin(vertices, normals, self.topology.faces_tensor)
            terms["normal"] = normal_cost(skin, hits, wanted)
        if self.weights.silhouette:
            mask = None if hits is None else hits.mask
            target = self.silhouettes[view]
            terms["silhouette"] = silhouette_cost(vertices, surface, target, mask)
        if self.weights.landmark:
            terms["landmark"] = self.evidence.loss(points, view)
        return terms
