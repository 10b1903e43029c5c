"""Bilaterally weighted normal integration: the equations, their energy and the reweighting loop.

Each pixel states the slope of its tangent plane four times, towards each neighbour, scaled by how
squarely it is seen: ``facing * (z_neighbour - z) + slope = 0`` towards right and down, the mirrored
form towards left and up. Where the two opposite statements disagree the surface may jump, and the
worse one loses its weight (Cao et al., "Bilateral Normal Integration", ECCV 2022, equations 12 to
18).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from harness.core.arrays import Floats
from methods.surface.lattice import Couplings, solve


@dataclass(frozen=True, slots=True)
class Equations:
    """The tangent planes of a grid of pixels; every array is (rows, columns), zero outside.

    Attributes:
        inside: Pixels that belong to the surface.
        facing_x, facing_y: Factor of the depth step along a row and along a column.
        slope_x, slope_y: What that product has to cancel, towards right and towards down.
    """

    inside: NDArray[np.bool_]
    facing_x: Floats
    facing_y: Floats
    slope_x: Floats
    slope_y: Floats

    def rearranged(self, place: Callable[[NDArray[Any]], NDArray[Any]]) -> Equations:
        """The equations with every array put through ``place``, as onto a larger grid."""
        return Equations(
            place(self.inside),
            place(self.facing_x),
            place(self.facing_y),
            place(self.slope_x),
            place(self.slope_y),
        )


@dataclass(frozen=True, slots=True)
class Anchors:
    """Quadratic ties of depth to a prior, and of one sheet to the other.

    Attributes:
        prior: (rows, columns) depth to stay close to.
        prior_weight: (rows, columns) weight of that, zero where there is no prior.
        link_weight: (rows, columns) weight of the difference to the pixel ``link_rows`` below.
        link_rows: An odd number of rows.
    """

    prior: Floats
    prior_weight: Floats
    link_weight: Floats
    link_rows: int


@dataclass(frozen=True, slots=True)
class Schedule:
    """How the reweighting goes on and when it ends, as published.

    ``k``, ``max_iter``, ``tol``, the solver tolerance 1e-3 and the start (depth 0, weights 0.5) are
    the published ones. A surface with jumps has many minima of nearly the same energy, so every
    change of the way there changes the result: a smaller k in the first rounds moves the error of
    one map by -16 to +3 %, and a tighter solver tolerance is better on some maps and worse on
    others. The published way keeps numbers comparable.

    Attributes:
        k: Sharpness of the choice between opposite sides; higher cuts more readily.
        max_iter: Most rounds of reweighting.
        tol: Relative change of energy that ends them.
        device: "cpu", or the torch device that solves the linear systems.
        solver_tol: Residual of the linear systems, relative to their right-hand side.
    """

    k: float
    max_iter: int
    tol: float
    device: str = "cpu"
    solver_tol: float = 1e-3


def integrate(
    equations: Equations, schedule: Schedule, anchors: Anchors | None = None
) -> tuple[Floats, list[float]]:
    """Depth (rows, columns) of least bilateral energy, and the energy after each round.

    Without anchors every connected part keeps a free constant.
    """
    depth = np.zeros(equations.inside.shape)
    weights = _Weights.even(equations)
    energy = _energy(equations, weights, depth, anchors)
    history: list[float] = []
    for _ in range(schedule.max_iter):
        if anchors is not None:
            depth = _shifted_to_prior(depth, equations.inside, anchors)
        system = _normal_equations(equations, weights, anchors)
        depth, _ = solve(system, depth, schedule.solver_tol, device=schedule.device)
        weights = _Weights.bilateral(equations, depth, schedule.k)
        previous, energy = energy, _energy(equations, weights, depth, anchors)
        history.append(energy)
        if abs(energy - previous) <= schedule.tol * previous:
            break
    return depth, history


@dataclass(frozen=True, slots=True)
class _Weights:
    """Weights (rows, columns) of the right and the down statement; left and up have the rest."""

    right: Floats
    down: Floats

    @classmethod
    def even(cls, equations: Equations) -> _Weights:
        half = np.full(equations.inside.shape, 0.5)
        return cls(half, half)

    @classmethod
    def bilateral(cls, equations: Equations, depth: Floats, k: float) -> _Weights:
        right, left, down, up = _scaled_steps(equations, depth)
        return cls(expit(k * (left**2 - right**2)), expit(k * (up**2 - down**2)))


def _steps(equations: Equations, depth: Floats) -> tuple[Floats, Floats]:
    """Depth steps to the right and down, zero where either end is outside."""
    inside = equations.inside
    across, along = np.zeros_like(depth), np.zeros_like(depth)
    np.subtract(depth[:, 1:], depth[:, :-1], out=across[:, :-1])
    np.subtract(depth[1:], depth[:-1], out=along[:-1])
    across[:, :-1] *= inside[:, 1:] & inside[:, :-1]
    along[:-1] *= inside[1:] & inside[:-1]
    across[:, -1] = 0.0
    along[-1] = 0.0
    return across, along


def _scaled_steps(equations: Equations, depth: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Steps to right, from left, down and from above, each scaled by the pixel's own facing."""
    across, along = _steps(equations, depth)
    right, down = equations.facing_x * across, equations.facing_y * along
    left, up = np.zeros_like(depth), np.zeros_like(depth)
    np.multiply(equations.facing_x[:, 1:], across[:, :-1], out=left[:, 1:])
    np.multiply(equations.facing_y[1:], along[:-1], out=up[1:])
    return right, left, down, up


def _energy(
    equations: Equations, weights: _Weights, depth: Floats, anchors: Anchors | None
) -> float:
    right, left, down, up = _scaled_steps(equations, depth)
    x, y = equations.slope_x, equations.slope_y
    energy = weights.right * (right + x) ** 2 + (1 - weights.right) * (left + x) ** 2
    energy += weights.down * (down + y) ** 2 + (1 - weights.down) * (up + y) ** 2
    if anchors is not None:
        rows = anchors.link_rows
        energy += anchors.prior_weight * (depth - anchors.prior) ** 2
        energy[:-rows] += anchors.link_weight[:-rows] * (depth[rows:] - depth[:-rows]) ** 2
    return float(energy.sum())


def _normal_equations(
    equations: Equations, weights: _Weights, anchors: Anchors | None
) -> Couplings:
    """The linear system of one round, tie by tie: no sparse matrix is multiplied."""
    inside = equations.inside
    shape = inside.shape
    diagonal, target = np.zeros(shape), np.zeros(shape)
    ties = []
    for axis, facing, slope, weight in (
        (1, equations.facing_x, equations.slope_x, weights.right),
        (0, equations.facing_y, equations.slope_y, weights.down),
    ):
        first = (slice(None), slice(None, -1)) if axis == 1 else (slice(None, -1), slice(None))
        second = (slice(None), slice(1, None)) if axis == 1 else (slice(1, None), slice(None))
        joined = inside[first] & inside[second]
        # A tie is stated twice: by its first pixel looking ahead, by its second looking back.
        scaled = weight * facing, (1 - weight) * facing
        strength = scaled[0][first] * facing[first] + scaled[1][second] * facing[second]
        pull = scaled[0][first] * slope[first] + scaled[1][second] * slope[second]
        strength *= joined
        pull *= joined
        diagonal[first] += strength
        diagonal[second] += strength
        target[first] += pull
        target[second] -= pull
        tie = np.zeros(shape)
        tie[first] = strength
        ties.append(tie)
    if anchors is None:
        return Couplings(diagonal, ties[0], ties[1], target)
    rows, link = anchors.link_rows, anchors.link_weight
    diagonal += anchors.prior_weight + link
    diagonal[rows:] += link[:-rows]
    target += anchors.prior_weight * anchors.prior
    return Couplings(diagonal, ties[0], ties[1], target, link, rows)


def _shifted_to_prior(depth: Floats, inside: NDArray[np.bool_], anchors: Anchors) -> Floats:
    """Depth with each sheet moved as a whole to its prior: what the solver would reach last."""
    shifted = depth.copy()
    for sheet in (slice(None, anchors.link_rows), slice(anchors.link_rows, None)):
        known = anchors.prior_weight[sheet] > 0
        if known.any():
            offset = (anchors.prior[sheet] - depth[sheet])[known].mean()
            shifted[sheet][inside[sheet]] += offset
    return shifted
